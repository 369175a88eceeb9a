from collections.abc import Callable

from arena.kernels.arrays import Floats, Integers
from arena.kernels.ordinary_datagrams import OrdinaryDatagrams
from arena.kernels.socket_waits import SocketWaits

class DatagramLoop:
    bytes_out: int
    unsent: int
    def __init__(
        self,
        ordinary: OrdinaryDatagrams,
        waits: SocketWaits,
        poll: int,
        fds: Integers,
        index_of_fd: Integers,
        on_other: Callable[[int, tuple[str, int], memoryview, float], None],
        on_late: Callable[[int, tuple[str, int], memoryview, float], None],
        on_event: Callable[[int], None],
    ) -> None: ...
    def run(self, until: float, world_s: Floats, world_until: float) -> None: ...
    def stop_timer(self) -> None: ...
