"""Function that reads the datagrams that wait in a UDP socket, many with one system call.

It has no Python source, because recvmmsg exists only in C. Without compiled kernels, `arena.datagrams` reads one datagram per call.
"""

from cpython.bytes cimport PyBytes_FromStringAndSize
from libc.errno cimport EINTR, errno
from libc.stdlib cimport calloc
from posix.time cimport timespec


cdef extern from "<netinet/in.h>" nogil:
    struct in_addr:
        unsigned int s_addr
    struct sockaddr_in:
        unsigned short sin_port
        in_addr sin_addr
    unsigned int ntohl(unsigned int)
    unsigned short ntohs(unsigned short)

cdef extern from "<sys/uio.h>" nogil:
    struct iovec:
        void *iov_base
        size_t iov_len

cdef extern from "<sys/socket.h>" nogil:
    int MSG_DONTWAIT
    struct msghdr:
        void *msg_name
        unsigned int msg_namelen
        iovec *msg_iov
        size_t msg_iovlen
    struct mmsghdr:
        msghdr msg_hdr
        unsigned int msg_len
    int recvmmsg(int fd, mmsghdr *vec, unsigned int count, int flags, timespec *timeout)

cdef enum:
    BATCH = 16          # datagrams of one system call
    DATAGRAM = 65536    # bytes
    MAX_SENDERS = 256   # addresses that are kept

# A call keeps the GIL, so one buffer serves all threads. Pages that no datagram has reached take no memory.
cdef char *buffer = <char *>calloc(BATCH, DATAGRAM)
cdef mmsghdr *inbox = <mmsghdr *>calloc(BATCH, sizeof(mmsghdr))
cdef iovec *pieces = <iovec *>calloc(BATCH, sizeof(iovec))
cdef sockaddr_in *senders = <sockaddr_in *>calloc(BATCH, sizeof(sockaddr_in))
cdef dict addresses = {}  # number of an address -> (host, port): the same few senders send all the time
cdef int k

if not (buffer and inbox and pieces and senders):
    raise MemoryError
for k in range(BATCH):
    pieces[k].iov_base, pieces[k].iov_len = &buffer[k * DATAGRAM], DATAGRAM
    inbox[k].msg_hdr.msg_iov, inbox[k].msg_hdr.msg_iovlen = &pieces[k], 1
    inbox[k].msg_hdr.msg_name = &senders[k]


cdef tuple address(sockaddr_in *sender):
    """Return an address as (host, port)."""
    cdef unsigned int host = ntohl(sender.sin_addr.s_addr)
    cdef unsigned short port = ntohs(sender.sin_port)
    cdef long number = <long>host << 16 | port
    found = addresses.get(number)
    if found is None:
        if len(addresses) >= MAX_SENDERS:
            addresses.clear()
        found = addresses[number] = f"{host >> 24}.{host >> 16 & 255}.{host >> 8 & 255}.{host & 255}", port
    return <tuple>found


def read_datagrams(int fd, int limit):
    """Return (datagram, sender) of the datagrams that have arrived at a UDP socket, oldest first. Never waits.

    fd: file descriptor of an IPv4 socket. limit: largest number of datagrams. An error of the socket ends the reading, as an empty
    socket does.
    """
    cdef list found = []
    cdef int count, wanted, i
    while limit > 0:
        wanted = BATCH if limit > BATCH else limit
        for i in range(wanted):
            inbox[i].msg_hdr.msg_namelen = sizeof(sockaddr_in)
        count = recvmmsg(fd, inbox, wanted, MSG_DONTWAIT, NULL)
        if count < 0 and errno == EINTR:
            continue
        for i in range(count):
            found.append((PyBytes_FromStringAndSize(&buffer[i * DATAGRAM], inbox[i].msg_len), address(&senders[i])))
        if count < wanted:
            break
        limit -= count
    return found
