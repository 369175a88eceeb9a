# C types of captured_poses.py: they make the compiled functions fast and change no result.
cimport cython
from libc cimport math

cdef double _H, _MAX_DISTANCE_M
cdef long _TRACKED

@cython.locals(norm=double, k=double, a=double, b=double, c=double, d=double)
cpdef object ned_pose(object body, double east, double north, double up, double x, double y, double z, double w)

@cython.locals(east=double, north=double, up=double, x=double, y=double, z=double, w=double)
cpdef object pose_ned(object body, (double, double, double) position_w, (double, double, double, double) quat_xyzw_wf)

@cython.locals(poses=list, untracked=list)
cpdef tuple measured_poses(object bodies, object names)

@cython.locals(at=Py_ssize_t, last=Py_ssize_t, count=double, p_n=tuple, q_nb=tuple)
cpdef void store_poses(object poses, dict begins, double[::1] page) except *

@cython.locals(found=list, untracked=list, invalid=long, body=tuple, east=double, north=double, up=double, x=double, y=double, z=double, w=double, params=long)
cpdef tuple natnet_poses(list bodies, dict names, object left_out)
