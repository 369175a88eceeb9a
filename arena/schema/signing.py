"""The YAML key `signing` of a real vehicle: MAVLink message signing with a key in a file."""

from collections.abc import Iterator, Mapping

from arena.errors import InputError
from arena.schema.base import Strict
from arena.schema.loader import YamlPath


class Signing(Strict):
    """MAVLink message signing of a hardware vehicle with PX4 1.18 or newer."""

    key_file: str
    """File with the key, relative to arena.yaml, mode 0600. `arena signing new` makes it, `arena signing setup` gives it to the vehicle."""


def key_problems(key_files: Mapping[str, str]) -> Iterator[tuple[YamlPath, str]]:
    """Yield (YAML path, problem) for each unusable key file.

    The text never contains the key.

    key_files: vehicle name -> path of its key file
    """
    from arena.signing_key import read_key  # imported late: most arenas have no signing key

    for name, file in key_files.items():
        try:
            read_key(file)
        except InputError as error:
            yield ("vehicles", name, "signing", "key_file"), f"{error}."
