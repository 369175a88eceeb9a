# C types of pose_selection.py: they make the compiled class fast and change no result.
cimport cython
from libc cimport math

from arena.kernels.frame_order cimport FrameOrder
from arena.kernels.lateness cimport Lateness

cdef double _MAX_DISTANCE_M

cdef class PoseSelection:
    cdef str _body
    cdef long long _every, _slot
    cdef double _stale_s
    cdef bint _noisy, _sent_slot
    cdef Py_ssize_t _place
    cdef object _last
    cdef FrameOrder _order
    cdef readonly object counts
    cdef public bint flying
    cdef readonly Lateness lateness
    cdef readonly double late_s
    cdef readonly long resets
    @cython.locals(place=str, reason=str, slot=cython.longlong)
    cpdef object take(self, object frame, double now)
    cpdef object newest(self, object frames, double now)
    @cython.locals(place=Py_ssize_t)
    cdef object _own_pose(self, object poses)
    cdef str _drop_reason(self, object frame, object pose)
    cdef void _restart(self) except *

@cython.locals(k=Py_ssize_t, selection=PoseSelection)
cpdef list newest_poses(list selections, object frames, double now)

@cython.locals(x=double, y=double, z=double, a=double, b=double, c=double, d=double)
cpdef bint is_pose(object pose) except -1
