from collections.abc import Callable, Sequence

from arena.kernels.arrays import Floats
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
        fds: Sequence[int],
        on_other: Callable[[int, tuple[str, int], memoryview, float], None],
        on_late: Callable[[int, tuple[str, int], memoryview, float], None],
        on_event: Callable[[int], None],
    ) -> None: ...
    def run(self, until: float, world_s: Floats, world_until: float) -> None: ...
    def stop_timer(self) -> None: ...
