# C types of captured_pose.py: they make the compiled functions fast and change no result.
cimport cython
from libc cimport math

cdef double _H, _MAX_DISTANCE_M
cdef long _TRACKED

@cython.locals(norm=double, k=double, qw=double, qx=double, qy=double, qz=double)
cpdef tuple ned_pose(double east, double north, double up, double x, double y, double z, double w)
@cython.locals(found=list, untracked=list, invalid=long, body=tuple, east=double, north=double, up=double, x=double, y=double, z=double, w=double, params=long, converted=tuple)
cpdef tuple ned_poses(list bodies, dict names, object left_out, object pose)
