"""Programs that misbehave: `misfit.py KIND [argument]`. Each prints its pid, so that a test can find it.

Tests start hundreds of them, so they import as little as possible, and run without `site` (`python -S`).
"""

from __future__ import annotations

import json
import os
import signal
import socket
import sys
import time
from pathlib import Path


def line() -> socket.socket:
    return socket.socket(fileno=int(os.environ["ARENA_FD"]))


def tell(**packet: object) -> None:
    if not hasattr(tell, "line"):
        tell.line = line()
    tell.line.send(json.dumps(packet).encode())


def forever() -> None:
    while True:
        signal.pause()


def good() -> None:
    """Report ready at once and end on SIGTERM."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    tell(ready=True)
    forever()


def ready_before_its_member() -> None:
    """Report ready at once, and the member `router` when the file given as argument exists. End on SIGTERM."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    tell(ready=True)
    while not Path(sys.argv[2]).exists():
        time.sleep(0.02)
    tell(ready=True, of="router")
    forever()


def ignores_sigterm() -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    tell(ready=True)
    forever()


def sleeps() -> None:
    forever()


def throws() -> None:
    raise ValueError("no such setpoint")


def burns() -> None:
    while True:
        pass


def never_ready() -> None:
    forever()


def dies_at_once() -> None:
    sys.exit(3)


def dies_after_ready() -> None:
    tell(ready=True)
    sys.exit(4)


def exits() -> None:
    sys.exit(int(sys.argv[2]))


def kills_itself() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def grandchild() -> None:
    """Start a grandchild in the same group and one in a new session; end when both run and their lines are in the log."""
    import subprocess

    code = "import os, signal, sys; print('grandchild', os.getpid(), flush=True); signal.signal(15, signal.SIG_IGN); signal.pause()"
    for own_session in (False, True):
        command = [sys.executable, "-c", code]
        child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=own_session)
        assert child.stdout is not None
        print(child.stdout.readline(), end="", flush=True)
    tell(ready=True)


def grandchild_in_group() -> None:
    """Start a grandchild that ignores SIGTERM in the same group; end when it runs and its line is in the log."""
    import subprocess

    command = [sys.executable, __file__, "ignores_sigterm_alone"]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    line = next(line for line in child.stdout if line.startswith("grandchild"))
    print(line, end="", flush=True)
    tell(ready=True)


def ignores_sigterm_alone() -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    print("grandchild", os.getpid(), flush=True)
    forever()


def flickers() -> None:
    """Report disarmed, armed again, and disarmed after 1 s."""
    tell(ready=True, facts={"uav1.armed": False})
    time.sleep(0.15)
    tell(facts={"uav1.armed": True})
    time.sleep(1.0)
    tell(facts={"uav1.armed": False}, stats={"disarmed": True})
    forever()


def prints_requests() -> None:
    """Report facts (the argument, as JSON), and print and confirm every request of the supervisor.

    SIGTERM ends it after the last one.
    """
    signal.signal(signal.SIGTERM, lambda *_: tell.line.setblocking(False))
    tell(ready=True, facts=json.loads(sys.argv[2]))
    while True:
        try:
            data = tell.line.recv(65536)
        except BlockingIOError:
            sys.exit(0)
        if not data:
            sys.exit(0)
        print(data.decode(), flush=True)
        if "id" in (request := json.loads(data)):
            tell(confirmed=request["id"])


def floods() -> None:
    """Print without end."""
    block = b"flood " * 10_000 + b"\n"
    while True:
        os.write(1, block)


def closes_its_line() -> None:
    tell(ready=True)
    tell.line.close()
    forever()


def garbage() -> None:
    mine = line()
    for packet in (
        b"\xff\x00\xfe",
        b"[1, 2]",
        b"{",
        b"[" * 60_000,
        b"null",
        b'{"facts": 3, "stats": [], "event": {}, "ready": "yes"}',
    ):
        mine.send(packet)
    mine.send(b'{"ready": true, "stats": {"after": 1}}')
    forever()


def chatters() -> None:
    """Send packets to the supervisor without end."""
    tell(ready=True)
    tell.line.setblocking(True)
    while True:
        tell(event="so", stats={"n": 1}, facts={"x": time.monotonic()})


def serves() -> None:
    """Listen on the TCP address HOST PORT without reporting it."""
    server = socket.create_server((sys.argv[2], int(sys.argv[3])))
    server.listen()
    forever()


def world() -> None:
    """Report ready and the facts in the argument (JSON); run until the supervisor's socket closes, then report and end."""
    mine = line()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    facts = json.loads(sys.argv[2]) if len(sys.argv) > 2 else {}
    mine.send(
        json.dumps(
            {"ready": True, "facts": facts, "stats": json.loads(sys.argv[3]) if len(sys.argv) > 3 else {}}
        ).encode()
    )
    watched = sys.argv[4] if len(sys.argv) > 4 else ""
    mine.settimeout(0.05)
    while True:
        try:
            if mine.recv(10) == b"":
                print("saw the end of the line", flush=True)
                return
        except TimeoutError:
            pass
        if watched and Path(watched).exists():
            mine.send(json.dumps({"facts": {name: False for name in facts}}).encode())
            watched = ""


def reports_arming() -> None:
    """Act as a router: report `uav1.armed` while the file in the argument exists. A stop signal ends it; it prints the state then.

    Second argument: time from the stop signal to the end [s].
    """
    stopped, flag, armed = [], Path(sys.argv[2]), None
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(1))
    tell(ready=True)
    while not stopped:
        if armed != flag.exists():
            armed = flag.exists()
            tell(facts={"uav1.connected": True, "uav1.armed": armed})
            print("reported", "ARMED" if armed else "disarmed", flush=True)
        time.sleep(0.02)
    time.sleep(float(sys.argv[3]) if len(sys.argv) > 3 else 0.0)
    print("ended while the vehicle is", "ARMED" if flag.exists() else "disarmed", flush=True)


def arms_at_its_end() -> None:
    """Arm the vehicle after the stop signal: create the file in the argument 0.3 s later, and end after 0.5 s more."""

    def end(*_: object) -> None:
        time.sleep(0.3)
        Path(sys.argv[2]).touch()
        print("armed", flush=True)
        time.sleep(0.5)
        sys.exit(0)

    signal.signal(signal.SIGTERM, end)
    print("flies", flush=True)
    forever()


def names() -> None:
    """Send as many facts with different names as the argument says."""
    for i in range(int(sys.argv[2])):
        tell(facts={f"wp{i}": i})
        time.sleep(0.0005)
    forever()


def says() -> None:
    """Send events without end, about 100 per second, and count them."""
    n = 0
    while True:
        n += 1
        tell(event=f"event {n} " + 100 * "x", stats={"n": n})
        time.sleep(0.01)


def needs_file() -> None:
    """Fail if the file in the argument cannot be read, else report ready."""
    Path(sys.argv[2]).read_text()
    good()


def disarms() -> None:
    """Act as a landing task: delete the file in the argument, which stands for the arming of the vehicle."""
    print("landing all", flush=True)
    Path(sys.argv[2]).unlink(missing_ok=True)
    print("landed all", flush=True)


def armed_at_its_end() -> None:
    """Act as a link whose pilot arms when the stop signal arrives: create the file in the argument, and end when it is gone."""
    stopped, flag = [], Path(sys.argv[2])
    signal.signal(signal.SIGTERM, lambda *_: (stopped.append(1), flag.touch()))
    tell(ready=True)
    while not stopped or flag.exists():
        if flag.exists():
            tell(stats={"armed": True})
        time.sleep(0.02)


def lands_once() -> None:
    """Act as a landing task: confirm the landing if the file in the argument does not exist, and create it."""
    flag = Path(sys.argv[2])
    if flag.exists():
        sys.exit(1)
    flag.touch()
    print("landed all", flush=True)


def lands() -> None:
    """Act as a landing task: wait for the file in the argument if given, create `landed`, end."""
    print("landing all", flush=True)
    deadline = time.monotonic() + 20
    while len(sys.argv) > 2 and not Path(sys.argv[2]).exists():
        if time.monotonic() > deadline:
            sys.exit(1)
        time.sleep(0.02)
    Path("landed").touch()
    print("landed all", flush=True)


if __name__ == "__main__":
    print("pid", os.getpid(), flush=True)
    globals()[sys.argv[1]]()
