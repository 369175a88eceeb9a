# C types of captured_poses.py: they make the compiled functions fast and change no result.
cimport cython
from libc cimport math

cdef double _H, _MAX_DISTANCE_M

@cython.locals(x=double, y=double, z=double, w=double, east=double, north=double, up=double, norm=double, k=double, a=double, b=double, c=double, d=double)
cpdef object pose_ned(object body, (double, double, double) position_w, (double, double, double, double) quat_xyzw_wf)

@cython.locals(poses=list, untracked=list)
cpdef tuple poses_ned(object bodies, object names)
