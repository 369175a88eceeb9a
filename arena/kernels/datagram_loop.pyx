"""Loop of the MAVLink router over its sockets: receives datagrams in batches, and sends ordinary datagrams in batches.

It has no Python source, because recvmmsg and sendmmsg exist only in C. Without compiled kernels,
`arena.mavlink_router.shell` does the same with one datagram per call.
"""

cimport cython
from cpython.exc cimport PyErr_CheckSignals
from libc.errno cimport EINTR, errno
from libc.stdlib cimport calloc, free
from posix.time cimport CLOCK_MONOTONIC, clock_gettime, timespec
from posix.unistd cimport close

from arena.kernels.ordinary_datagrams cimport OrdinaryDatagrams
from arena.kernels.socket_waits cimport SocketWaits


cdef extern from "<sys/epoll.h>" nogil:
    ctypedef union epoll_data_t:
        int fd
    struct epoll_event:
        unsigned int events
        epoll_data_t data
    int EPOLL_CTL_ADD, EPOLLIN
    int epoll_ctl(int epfd, int operation, int fd, epoll_event *event)
    int epoll_wait(int epfd, epoll_event *events, int maxevents, int timeout)

cdef extern from "<sys/timerfd.h>" nogil:
    int TFD_NONBLOCK, TFD_CLOEXEC, TFD_TIMER_ABSTIME
    struct itimerspec:
        timespec it_interval
        timespec it_value
    int timerfd_create(int clock, int flags)
    int timerfd_settime(int fd, int flags, itimerspec *new_value, itimerspec *old_value)

cdef extern from "<netinet/in.h>" nogil:
    struct in_addr:
        unsigned int s_addr
    struct sockaddr_in:
        unsigned short sin_family
        unsigned short sin_port
        in_addr sin_addr
    unsigned int htonl(unsigned int)
    unsigned short htons(unsigned short)

cdef extern from "<sys/uio.h>" nogil:
    struct iovec:
        void *iov_base
        size_t iov_len

cdef extern from "<sys/socket.h>" nogil:
    int AF_INET, MSG_DONTWAIT
    struct sockaddr:
        pass
    struct msghdr:
        void *msg_name
        unsigned int msg_namelen
        iovec *msg_iov
        size_t msg_iovlen
    struct mmsghdr:
        msghdr msg_hdr
        unsigned int msg_len
    Py_ssize_t recvfrom(int fd, void *data, size_t size, int flags, sockaddr *sender, unsigned int *sender_size)
    int recvmmsg(int fd, mmsghdr *vec, unsigned int count, int flags, timespec *timeout)
    Py_ssize_t sendto(int fd, const void *data, size_t size, int flags, const sockaddr *receiver, unsigned int receiver_size)
    int sendmmsg(int fd, mmsghdr *vec, unsigned int count, int flags)

cdef extern from "Python.h":
    ctypedef struct PyInterpreterState:
        pass
    ctypedef struct PyThreadState:
        pass
    PyThreadState *PyThreadState_Get()
    PyInterpreterState *PyThreadState_GetInterpreter(PyThreadState *thread)
    PyThreadState *PyInterpreterState_ThreadHead(PyInterpreterState *interpreter)
    PyThreadState *PyThreadState_Next(PyThreadState *thread)

cdef enum:
    BATCH = 16          # datagrams read from one socket at a time: a flood on one socket must not delay the others
    DATAGRAM = 65536    # bytes
    SENDS = 512         # messages of one sendmmsg

cdef double BUSY_S = 0.0001  # a poll that ends this soon after the last reading has not waited for a datagram [s]

cdef struct Socket:
    long polled     # number of the last poll that reported the socket
    int fd

cdef struct Batch:
    sockaddr_in senders[BATCH]
    iovec single
    mmsghdr inbox[BATCH]
    iovec pieces[2 * BATCH]


cdef double monotonic() noexcept:
    cdef timespec t
    clock_gettime(CLOCK_MONOTONIC, &t)
    return t.tv_sec + 1e-9 * t.tv_nsec


cdef bint is_only_thread():
    """Return whether this thread is the only one that runs Python, so that no other thread waits for the interpreter lock."""
    cdef PyThreadState *this = PyThreadState_Get()
    return PyInterpreterState_ThreadHead(PyThreadState_GetInterpreter(this)) == this and PyThreadState_Next(this) == NULL


@cython.final
@cython.auto_pickle(False)
cdef class Receivers:
    """A set of receivers as C structures, ordered by the socket to send from.

    messages: for each receiver, a message with the datagram `DatagramLoop.batch.single`
    """

    cdef long version
    cdef int count
    cdef mmsghdr *messages
    cdef sockaddr_in *addresses
    cdef int *fds

    def __dealloc__(self):
        free(self.messages)

    cdef int allocate(self, int count) except -1:
        """Allocate memory for a number of receivers, in one block, because less memory then has to be loaded for a message."""
        free(self.messages)
        self.count = 0
        self.messages = <mmsghdr *>calloc(count + 1, sizeof(mmsghdr) + sizeof(sockaddr_in) + sizeof(int))
        if not self.messages:
            raise MemoryError
        self.addresses = <sockaddr_in *>&self.messages[count]
        self.fds = <int *>&self.addresses[count]
        self.count = count
        return 0


@cython.final
@cython.auto_pickle(False)
cdef class DatagramLoop:
    """Receives datagrams from sockets, sends the ordinary ones to their receivers, and gives all others to Python.

    A message is routed while most of the memory is not in the caches of the processor. What one message needs therefore lies
    together, and the usual case, one datagram, has functions of its own.

    bytes_out, unsent: number of bytes that were sent, and of datagrams that a full queue or a missing network prevented
    """

    cdef OrdinaryDatagrams ordinary
    cdef SocketWaits waits
    cdef object on_other, on_late, on_event
    cdef public long bytes_out, unsent
    cdef int poll, most_events, timer, fd_count
    cdef double timer_at, read_at
    cdef long polls
    cdef bint busy
    cdef Batch *batch
    cdef Socket *sockets
    cdef epoll_event *events
    cdef int *index_of_fd
    cdef mmsghdr *outbox
    cdef list sets
    cdef unsigned char[::1] buffer

    def __cinit__(self, OrdinaryDatagrams ordinary, SocketWaits waits, int poll, fds, on_other, on_late, on_event):
        """Allocate the memory.

        poll: file descriptor of the epoll object. fds: file descriptors of the router's sockets, in their order
        on_other: is called with (socket, sender, data, monotonic time [s]) for a datagram that is not ordinary
        on_late: is called like on_other for a datagram that may have become old while the process was stalled
        on_event: is called with a file descriptor that is not a socket of the router, or whose datagrams may be old
        """
        cdef int i, count = len(fds)
        self.ordinary, self.waits, self.poll = ordinary, waits, poll
        self.on_other, self.on_late, self.on_event = on_other, on_late, on_event
        self.sets = [Receivers() for _ in ordinary.receivers]
        self.buffer = bytearray(BATCH * DATAGRAM)
        # A poll must report every readable socket, because a socket that it does not report counts as empty.
        self.most_events, self.fd_count = count + 16, 1 + max(fds)
        self.batch = <Batch *>calloc(
            1,
            sizeof(Batch) + count * sizeof(Socket) + self.most_events * sizeof(epoll_event) + self.fd_count * sizeof(int),
        )
        self.outbox = <mmsghdr *>calloc(SENDS, sizeof(mmsghdr))
        if not (self.batch and self.outbox):
            raise MemoryError
        self.sockets = <Socket *>&self.batch[1]
        self.events = <epoll_event *>&self.sockets[count]
        self.index_of_fd = <int *>&self.events[self.most_events]
        for i in range(self.fd_count):
            self.index_of_fd[i] = -1
        for i in range(count):
            self.sockets[i].fd = fds[i]
            self.index_of_fd[self.sockets[i].fd] = i
        self.timer, self.timer_at = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC), 0.0
        self.events[0].events, self.events[0].data.fd = EPOLLIN, self.timer
        if self.timer < 0 or epoll_ctl(poll, EPOLL_CTL_ADD, self.timer, self.events) < 0:
            raise OSError("the router cannot create a timer")
        self.batch.single.iov_base = &self.buffer[0]
        for i in range(BATCH):
            self.batch.pieces[i].iov_base = &self.buffer[i * DATAGRAM]
            self.batch.pieces[i].iov_len = DATAGRAM
            self.batch.pieces[BATCH + i].iov_base = &self.buffer[i * DATAGRAM]
            self.batch.inbox[i].msg_hdr.msg_iov = &self.batch.pieces[i]
            self.batch.inbox[i].msg_hdr.msg_iovlen = 1
            self.batch.inbox[i].msg_hdr.msg_name = &self.batch.senders[i]

    def __dealloc__(self):
        if self.timer > 0:
            close(self.timer)
        free(self.batch)
        free(self.outbox)

    def run(self, double until, const double[::1] world_s, double world_until):
        """Route datagrams until a time, or until `on_other` or `on_event` was called.

        until: monotonic [s]. world_s: simulation time [s] (1,). world_until: end also at this simulation time [s]
        """
        cdef double now = monotonic()
        cdef int count, wait_ms, i
        # Only Python code starts threads, and the loop ends after Python code has run.
        cdef bint called, only_thread = is_only_thread()
        self._set_timer(until)
        while True:
            self.waits.before_poll(now)
            wait_ms = 0 if until <= now else -1
            if only_thread:
                count = epoll_wait(self.poll, self.events, self.most_events, wait_ms)
            else:
                with nogil:
                    count = epoll_wait(self.poll, self.events, self.most_events, wait_ms)
            called = count < 0
            if called:  # a signal: Python reads its result
                PyErr_CheckSignals()
                count = epoll_wait(self.poll, self.events, self.most_events, 0)
            now = monotonic()
            self.polls += 1
            self.busy = now - self.read_at < BUSY_S
            for i in range(count):  # the process may have been stalled since the poll, so the time is read again
                called = self._on_event(self.events[i].data.fd, now if i == 0 else monotonic()) or called
            if called or now >= until or world_s[0] >= world_until:
                return

    cdef inline bint _on_event(self, int fd, double now) except -1:
        """Process a readable file descriptor. Return whether a function of Python was called.

        now: monotonic [s].
        """
        cdef bint again
        cdef int socket = self.index_of_fd[fd] if fd < self.fd_count else -1
        if fd == self.timer:
            self.timer_at = -1.0  # it stays readable until it is set again
            return False
        if socket < 0 or self.waits.may_be_old(socket, now):
            self.on_event(fd)
            return True
        again, self.sockets[socket].polled = self.sockets[socket].polled == self.polls - 1, self.polls
        # A socket that is readable again at once probably contains several datagrams.
        return self._read_batch(socket) if again and self.busy else self._read(socket)

    cdef inline bint _read(self, int socket) except -1:
        """Read and route one datagram. recvmmsg would search for a second one."""
        cdef unsigned int sender_size = sizeof(sockaddr_in)
        cdef long number
        cdef Py_ssize_t size = recvfrom(
            self.sockets[socket].fd, self.batch.single.iov_base, DATAGRAM, MSG_DONTWAIT,
            <sockaddr *>self.batch.senders, &sender_size
        )
        cdef double now = monotonic()  # after the reading: a stall before it has made the datagram old
        self.read_at = now
        if size < 0:
            return False
        if self.waits.is_old(socket, now):
            self._give(self.on_late, socket, 0, size, now)
            return True
        number = self.ordinary.find(socket, self._sender(0), self.buffer, 0, size, now)
        if number < 0:
            self._give(self.on_other, socket, 0, size, now)
            return True
        self.batch.single.iov_len = size
        self._send_single(self._receivers(number))
        return False

    cdef inline int _send_single(self, Receivers receivers) noexcept:
        """Send the datagram `single` to all receivers. A receiver that cannot be reached is left out: the next message is newer."""
        cdef int k = 0, end, sent
        cdef int *fds = receivers.fds
        while k < receivers.count:
            end = k + 1
            while end < receivers.count and fds[end] == fds[k]:
                end += 1
            if end == k + 1:
                sent = 1 if sendto(
                    fds[k], self.batch.single.iov_base, self.batch.single.iov_len, MSG_DONTWAIT,
                    <sockaddr *>&receivers.addresses[k], sizeof(sockaddr_in)
                ) >= 0 else -1
            else:
                sent = sendmmsg(fds[k], &receivers.messages[k], end - k, MSG_DONTWAIT)
            if sent > 0:
                self.bytes_out += sent * <long>self.batch.single.iov_len
                k += sent
            elif errno != EINTR:
                self.unsent += 1
                k += 1
        return 0

    def stop_timer(self):
        """Stop the timer. Call this before another poll of the epoll object than that of `run`."""
        self._set_timer(0.0)

    cdef int _set_timer(self, double at) except -1:
        """Make the epoll object readable from a time on, 0: never. A time-out of epoll_wait would set a timer for each message."""
        cdef itimerspec value
        if at == self.timer_at:
            return 0
        value.it_interval.tv_sec = value.it_interval.tv_nsec = 0
        value.it_value.tv_sec = <long>at
        value.it_value.tv_nsec = <long>(1e9 * (at - <long>at))
        if timerfd_settime(self.timer, TFD_TIMER_ABSTIME, &value, NULL) < 0:
            raise OSError("the router cannot set its timer")
        self.timer_at = at
        return 0

    cdef bint _read_batch(self, int socket) except -1:
        """Read and route up to `BATCH` datagrams. Return whether a function of Python was called."""
        cdef int i, count, first = 0
        cdef long number, last = -1
        cdef bint called = False
        for i in range(BATCH):
            self.batch.inbox[i].msg_hdr.msg_namelen = sizeof(sockaddr_in)
        count = recvmmsg(self.sockets[socket].fd, self.batch.inbox, BATCH, MSG_DONTWAIT, NULL)
        cdef double now = monotonic()  # after the reading: a stall before it has made the datagrams old
        self.read_at = now
        for i in range(count):
            if self.waits.is_old(socket, now):
                self._send(last, first, i)
                first, last = i + 1, -1
                self._give(self.on_late, socket, i, self.batch.inbox[i].msg_len, now)
                called, now = True, monotonic()
                continue
            number = self.ordinary.find(
                socket, self._sender(i), self.buffer, i * DATAGRAM, i * DATAGRAM + <long>self.batch.inbox[i].msg_len, now
            )
            if number != last or number < 0:
                self._send(last, first, i)
                first, last = i, number
            if number < 0:
                self._give(self.on_other, socket, i, self.batch.inbox[i].msg_len, now)
                called, now = True, monotonic()
        self._send(last, first, count)
        return called

    cdef inline long _sender(self, int i) noexcept:
        """Return the address of the sender of datagram i as `ordinary_datagrams.address_number` does."""
        return <long>htonl(self.batch.senders[i].sin_addr.s_addr) << 16 | htons(self.batch.senders[i].sin_port)

    cdef int _give(self, function, long socket, int i, Py_ssize_t size, double now) except -1:
        cdef unsigned int host = htonl(self.batch.senders[i].sin_addr.s_addr)
        cdef long start = i * DATAGRAM
        data = memoryview(self.buffer)[start:start + size]
        name = f"{host >> 24}.{host >> 16 & 255}.{host >> 8 & 255}.{host & 255}"
        function(socket, (name, htons(self.batch.senders[i].sin_port)), data, now)
        return 0

    cdef int _send(self, long number, int first, int end) except -1:
        """Send datagrams first to end to all receivers of a set, grouped by the socket to send from."""
        cdef Receivers receivers
        cdef int i, k, fd, count = 0
        if number < 0 or first >= end:
            return 0
        receivers = self._receivers(number)
        for k in range(receivers.count):
            fd = receivers.fds[k]
            for i in range(first, end):
                self.batch.pieces[BATCH + i].iov_len = self.batch.inbox[i].msg_len
                self.outbox[count].msg_hdr.msg_name = &receivers.addresses[k]
                self.outbox[count].msg_hdr.msg_namelen = sizeof(sockaddr_in)
                self.outbox[count].msg_hdr.msg_iov = &self.batch.pieces[BATCH + i]
                self.outbox[count].msg_hdr.msg_iovlen = 1
                count += 1
            if k + 1 == receivers.count or receivers.fds[k + 1] != fd or count + BATCH > SENDS:
                self._flush(fd, count)
                count = 0
        return 0

    cdef int _flush(self, int fd, int count) except -1:
        """Send the first messages of the outbox. A message that cannot be sent is left out: the next message is newer."""
        cdef int at = 0, sent, i
        while at < count:
            sent = sendmmsg(fd, &self.outbox[at], count - at, MSG_DONTWAIT)
            if sent < 0 and errno == EINTR:
                continue
            for i in range(at, at + sent):
                self.bytes_out += self.outbox[i].msg_len
            if sent > 0:
                at += sent
            else:
                self.unsent += 1
                at += 1
        return 0

    cdef inline Receivers _receivers(self, long number):
        """Return a set of receivers. It is built again after a change."""
        cdef Receivers found = <Receivers>self.sets[number]
        if found.version != self.ordinary.versions[number]:
            self._build(found, number)
        return found

    cdef int _build(self, Receivers receivers, long number) except -1:
        cdef int k = 0
        receivers.allocate(len(self.ordinary.receivers[number]))
        for socket, (host, port) in sorted(self.ordinary.receivers[number]):
            a, b, c, d = (int(part) for part in host.split("."))
            receivers.fds[k] = self.sockets[<int>socket].fd
            receivers.addresses[k].sin_family = AF_INET
            receivers.addresses[k].sin_addr.s_addr = htonl(<unsigned int>(a << 24 | b << 16 | c << 8 | d))
            receivers.addresses[k].sin_port = htons(<unsigned short>port)
            receivers.messages[k].msg_hdr.msg_name = &receivers.addresses[k]
            receivers.messages[k].msg_hdr.msg_namelen = sizeof(sockaddr_in)
            receivers.messages[k].msg_hdr.msg_iov = &self.batch.single
            receivers.messages[k].msg_hdr.msg_iovlen = 1
            k += 1
        receivers.version = self.ordinary.versions[number]
        return 0
