"""Files of MAVLink signing: the key of a vehicle, and the last timestamp of a signature.

The key file contains 64 hexadecimal digits. Only its owner may read it. Its content is never logged and never
copied. The last timestamp is in a file beside it, `<key file>.timestamp`.
"""

from __future__ import annotations

import contextlib
import os
import stat
import threading
from pathlib import Path

from arena.errors import InputError
from arena.wire.mavlink_signing import KEY_BYTES, TICKS_PER_S

SAVE_S = 5.0
"""Time between two writes of the timestamp [s]."""
_OTHERS = stat.S_IRWXG | stat.S_IRWXO
_MOST_BYTES = 1024


def read_key(file: str | Path) -> bytes:
    """Return the signing key in a file.

    Raises InputError if the file cannot be read, has no key, or can be read by other users.

    The message never contains the content of the file.
    """
    try:
        opened = os.open(file, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except OSError as error:
        raise InputError(
            f"signing key {file}: cannot be read: {error.strerror}. `arena signing new FILE` makes a key"
        ) from error
    try:
        status = os.fstat(opened)
        if not stat.S_ISREG(status.st_mode):
            raise InputError(
                f"signing key {file}: is not a file. Give the path of a key file. `arena signing new FILE` makes one"
            )
        if status.st_mode & _OTHERS:
            mode = stat.S_IMODE(status.st_mode)
            raise InputError(
                f"signing key {file}: other users can use it (mode {mode:04o}, expected 0600). Run `chmod 600 {file}`. "
                "If somebody may have read it, make a new key"
            )
        if os.geteuid() not in (0, status.st_uid):
            raise InputError(
                f"signing key {file}: belongs to another user (uid {status.st_uid}). If the key is yours, run `sudo chown $USER {file}`"
            )
        content = os.read(opened, _MOST_BYTES)
    except OSError as error:
        raise InputError(f"signing key {file}: cannot be read: {error.strerror}") from error
    finally:
        os.close(opened)
    with contextlib.suppress(ValueError):  # the error would contain the content
        key = bytes.fromhex(content.decode("ascii", errors="replace").strip())
        if len(key) == KEY_BYTES and any(key):
            return key
    raise InputError(
        f"signing key {file}: does not contain a key: expected {2 * KEY_BYTES} hexadecimal digits, not all of them 0. "
        "`arena signing new FILE` makes a key"
    )


def write_new_key(file: Path) -> None:
    """Make a random signing key and write it to a new file with mode 0600.

    Raises InputError if the file exists.
    """
    text = os.urandom(KEY_BYTES).hex() + "\n"
    try:
        opened = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    except FileExistsError as error:
        raise InputError(
            f"{file} exists, and is not replaced: vehicles may use this key. Choose another name"
        ) from error
    except OSError as error:
        raise InputError(f"{file} cannot be written: {error.strerror}") from error
    try:
        os.fchmod(opened, 0o600)
        os.write(opened, text.encode())
        os.fsync(opened)
    finally:
        os.close(opened)


class TimestampFile:
    """File with the newest MAVLink signing timestamp that was used with a signing key.

    A restarted process then does not use an older timestamp. The vehicle refuses messages with older
    timestamps. Several processes may use the same file: the newest timestamp is kept.

    problem: why the last write failed; "" if it did not
    """

    def __init__(self, key_file: str | Path) -> None:
        self.path = Path(f"{key_file}.timestamp")
        self.problem = ""
        self._writing: threading.Thread | None = None
        self._saved_at: float | None = None

    def first(self) -> int:
        """Return the first timestamp with which this process may sign a frame; 0 if there is no file.

        It is later than the timestamp in the file, because newer timestamps may have been used after the last write.
        """
        last = self._read()
        return last + int(SAVE_S * TICKS_PER_S) if last else 0

    def save(self, timestamp: int, now: float) -> None:
        """Write the signing timestamp in a thread, at most once per SAVE_S.

        A slow disk does not delay the caller.

        now: monotonic [s]
        """
        due = self._saved_at is None or now - self._saved_at >= SAVE_S
        if not due or (self._writing is not None and self._writing.is_alive()):
            return
        self._saved_at = now
        self._writing = threading.Thread(target=self.write, args=(timestamp,), daemon=True)
        self._writing.start()

    def write(self, timestamp: int) -> None:
        """Write the signing timestamp, unless the file contains a newer one.

        Never raises OSError.
        """
        half = self.path.with_name(f"{self.path.name}.{os.getpid()}")
        try:
            half.write_text(f"{max(timestamp, self._read())}\n")
            half.replace(self.path)
            self.problem = ""
        except OSError as error:
            self.problem = f"{self.path} cannot be written: {error.strerror}"

    def _read(self) -> int:
        with contextlib.suppress(OSError, ValueError):
            return max(0, int(self.path.read_text()[:32]))
        return 0
