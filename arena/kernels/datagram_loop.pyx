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
    struct msghdr:
        void *msg_name
        unsigned int msg_namelen
        iovec *msg_iov
        size_t msg_iovlen
    struct mmsghdr:
        msghdr msg_hdr
        unsigned int msg_len
    int recvmmsg(int fd, mmsghdr *vec, unsigned int count, int flags, timespec *timeout)
    int sendmmsg(int fd, mmsghdr *vec, unsigned int count, int flags)

cdef enum:
    BATCH = 16          # datagrams read from one socket at a time: a flood on one socket must not delay the others
    DATAGRAM = 65536    # bytes
    SENDS = 512         # messages of one sendmmsg
    MAX_RECEIVERS = 256  # as in ordinary_datagrams


cdef double monotonic() noexcept:
    cdef timespec t
    clock_gettime(CLOCK_MONOTONIC, &t)
    return t.tv_sec + 1e-9 * t.tv_nsec


@cython.auto_pickle(False)
cdef class Receivers:
    """A set of receivers as C structures, ordered by the socket to send from."""

    cdef long version
    cdef int count
    cdef int fds[MAX_RECEIVERS]
    cdef sockaddr_in addresses[MAX_RECEIVERS]


@cython.auto_pickle(False)
cdef class DatagramLoop:
    """Receives datagrams from sockets, sends the ordinary ones to their receivers, and gives all others to Python.

    bytes_out, unsent: number of bytes that were sent, and of datagrams that a full queue or a missing network prevented
    """

    cdef OrdinaryDatagrams ordinary
    cdef SocketWaits waits
    cdef object on_other, on_late, on_event
    cdef public long bytes_out, unsent
    cdef int poll, most_events, timer
    cdef double timer_at
    cdef long[::1] fds, index_of_fd
    cdef list sets
    cdef unsigned char[::1] buffer
    cdef mmsghdr *inbox
    cdef mmsghdr *outbox
    cdef iovec *pieces
    cdef sockaddr_in *senders
    cdef epoll_event *events

    def __cinit__(self, OrdinaryDatagrams ordinary, SocketWaits waits, int poll, long[::1] fds, long[::1] index_of_fd,
                  on_other, on_late, on_event):
        """Allocate the memory.

        poll: file descriptor of the epoll object. fds: file descriptors of the router's sockets, in their order
        index_of_fd: index of a socket by its file descriptor, -1 for others
        on_other: is called with (socket, sender, data, monotonic time [s]) for a datagram that is not ordinary
        on_late: is called like on_other for a datagram that may have become old while the process was stalled
        on_event: is called with a file descriptor that is not a socket of the router, or whose datagrams may be old
        """
        cdef int i
        self.ordinary, self.waits, self.poll = ordinary, waits, poll
        self.fds, self.index_of_fd = fds, index_of_fd
        self.on_other, self.on_late, self.on_event = on_other, on_late, on_event
        self.sets = [Receivers() for _ in ordinary.receivers]
        self.buffer = bytearray(BATCH * DATAGRAM)
        self.inbox = <mmsghdr *>calloc(BATCH, sizeof(mmsghdr))
        self.pieces = <iovec *>calloc(2 * BATCH, sizeof(iovec))
        self.senders = <sockaddr_in *>calloc(BATCH, sizeof(sockaddr_in))
        self.outbox = <mmsghdr *>calloc(SENDS, sizeof(mmsghdr))
        # A poll must report every readable socket, because a socket that it does not report counts as empty.
        self.most_events = fds.shape[0] + 16
        self.events = <epoll_event *>calloc(self.most_events, sizeof(epoll_event))
        if not (self.inbox and self.pieces and self.senders and self.outbox and self.events):
            raise MemoryError
        self.timer, self.timer_at = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC), 0.0
        self.events[0].events, self.events[0].data.fd = EPOLLIN, self.timer
        if self.timer < 0 or epoll_ctl(poll, EPOLL_CTL_ADD, self.timer, self.events) < 0:
            raise OSError("the router cannot create a timer")
        for i in range(BATCH):
            self.pieces[i].iov_base = &self.buffer[i * DATAGRAM]
            self.pieces[i].iov_len = DATAGRAM
            self.pieces[BATCH + i].iov_base = &self.buffer[i * DATAGRAM]
            self.inbox[i].msg_hdr.msg_iov = &self.pieces[i]
            self.inbox[i].msg_hdr.msg_iovlen = 1
            self.inbox[i].msg_hdr.msg_name = &self.senders[i]

    def __dealloc__(self):
        if self.timer > 0:
            close(self.timer)
        free(self.inbox)
        free(self.pieces)
        free(self.senders)
        free(self.outbox)
        free(self.events)

    def run(self, double until, const double[::1] world_s, double world_until):
        """Route datagrams until a time, or until `on_other` or `on_event` was called.

        until: monotonic [s]. world_s: simulation time [s] (1,). world_until: end also at this simulation time [s]
        """
        cdef double now = monotonic()
        cdef int count, wait_ms, i
        cdef bint called
        self._set_timer(until)
        while True:
            self.waits.before_poll(now)
            wait_ms = 0 if until <= now else -1
            with nogil:
                count = epoll_wait(self.poll, self.events, self.most_events, wait_ms)
            called = count < 0
            if called:  # a signal: Python reads its result
                PyErr_CheckSignals()
                count = epoll_wait(self.poll, self.events, self.most_events, 0)
            now = monotonic()
            for i in range(count):
                called = self._on_event(self.events[i].data.fd) or called
            PyErr_CheckSignals()
            if called or now >= until or world_s[0] >= world_until:
                return

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

    cdef bint _on_event(self, int fd) except -1:
        """Process a readable file descriptor. Return whether a function of Python was called.

        The process may have been stalled since the poll, so the time is read again.
        """
        cdef double now = monotonic()
        if fd == self.timer:
            return self._set_timer(0.0)
        cdef long socket = self.index_of_fd[fd] if fd < self.index_of_fd.shape[0] else -1
        if socket < 0 or self.waits.may_be_old(socket, now):
            self.on_event(fd)
            return True
        return self._read(socket)

    cdef bint _read(self, long socket) except -1:
        cdef int i, count, first = 0
        cdef long number, last = -1
        cdef bint called = False
        for i in range(BATCH):
            self.inbox[i].msg_hdr.msg_namelen = sizeof(sockaddr_in)
        count = recvmmsg(<int>self.fds[socket], self.inbox, BATCH, MSG_DONTWAIT, NULL)
        cdef double now = monotonic()  # after the reading: a stall before it has made the datagrams old
        for i in range(count):
            if self.waits.is_old(socket, now):
                self._send(last, first, i)
                first, last = i + 1, -1
                self._give(self.on_late, socket, i, now)
                called, now = True, monotonic()
                continue
            number = self.ordinary.find(
                socket, self._sender(i), self.buffer, i * DATAGRAM, i * DATAGRAM + <long>self.inbox[i].msg_len, now
            )
            if number != last or number < 0:
                self._send(last, first, i)
                first, last = i, number
            if number < 0:
                self._give(self.on_other, socket, i, now)
                called, now = True, monotonic()
        self._send(last, first, count)
        return called

    cdef long _sender(self, int i) noexcept:
        """Return the address of the sender of datagram i as `ordinary_datagrams.address_number` does."""
        return <long>htonl(self.senders[i].sin_addr.s_addr) << 16 | htons(self.senders[i].sin_port)

    cdef int _give(self, function, long socket, int i, double now) except -1:
        cdef unsigned int host = htonl(self.senders[i].sin_addr.s_addr)
        cdef long start = i * DATAGRAM
        data = memoryview(self.buffer)[start:start + <long>self.inbox[i].msg_len]
        name = f"{host >> 24}.{host >> 16 & 255}.{host >> 8 & 255}.{host & 255}"
        function(socket, (name, htons(self.senders[i].sin_port)), data, now)
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
                self.pieces[BATCH + i].iov_len = self.inbox[i].msg_len
                self.outbox[count].msg_hdr.msg_name = &receivers.addresses[k]
                self.outbox[count].msg_hdr.msg_namelen = sizeof(sockaddr_in)
                self.outbox[count].msg_hdr.msg_iov = &self.pieces[BATCH + i]
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

    cdef Receivers _receivers(self, long number):
        """Return a set of receivers. It is built again after a change."""
        cdef Receivers found = self.sets[number]
        cdef int k = 0
        if found.version == self.ordinary.versions[number]:
            return found
        for socket, (host, port) in sorted(self.ordinary.receivers[number]):
            a, b, c, d = (int(part) for part in host.split("."))
            found.fds[k] = <int>self.fds[socket]
            found.addresses[k].sin_family = AF_INET
            found.addresses[k].sin_addr.s_addr = htonl(<unsigned int>(a << 24 | b << 16 | c << 8 | d))
            found.addresses[k].sin_port = htons(<unsigned short>port)
            k += 1
        found.count, found.version = k, self.ordinary.versions[number]
        return found
