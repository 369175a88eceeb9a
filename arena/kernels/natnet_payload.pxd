# C types of natnet_payload.py: they make the compiled class fast and change no result.
cimport cython

cdef long _HEAD_BYTES, _BODY_BYTES, _LABELLED_BYTES, _STAMPS_BYTES, _SIZED_TAIL_BYTES

@cython.locals(size=Py_ssize_t)
cpdef long message_of(bytes data) except -1
@cython.locals(message=long)
cpdef bytes payload_of(bytes data, long expected)

@cython.final
cdef class PayloadReader:
    cdef public bytes data
    cdef public Py_ssize_t at
    @cython.locals(data=bytes, at=Py_ssize_t, highest=long)
    cpdef long i32(self) except? -1
    cpdef long u16(self) except? -1
    @cython.locals(value=long)
    cpdef long count(self, str what) except -1
    cpdef void skip(self, Py_ssize_t size) except *
    @cython.locals(size=Py_ssize_t)
    cpdef bytes section(self)
    @cython.locals(begin=Py_ssize_t, size=Py_ssize_t)
    cpdef void skip_sections(self, long how_many) except *
    @cython.locals(end=Py_ssize_t)
    cpdef str text(self)
    @cython.locals(begin=Py_ssize_t, end=Py_ssize_t, size=Py_ssize_t, count=long, k=long, found=list)
    cpdef list bodies(self, object wanted, bint sized)
    @cython.locals(sized=bint, number=long, bodies=list, at=Py_ssize_t, stamps=tuple)
    cpdef tuple frame(self, object wanted, tuple version, bint known)
    cpdef void skip_to_stamps(self, bint sized) except *
    cpdef void skip_samples(self, str what) except *
