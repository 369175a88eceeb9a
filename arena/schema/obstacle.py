"""The entries of `world.obstacles` of arena.yaml."""

import math
import re
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from arena.obstacles import DEFAULT_COLOUR, SIZES, full_size, half_extents
from arena.obstacles import Obstacle as Body
from arena.schema.base import Positive, Strict, Vector


def _colour(text: str) -> str:
    if not re.fullmatch(r"#[0-9a-fA-F]{6}", text):
        raise ValueError("expected a colour such as '#8d99ae', in quotes")
    return text


class Obstacle(Strict):
    """A fixed box, cylinder or sphere in the room."""

    shape: Literal["box", "cylinder", "sphere"] = "box"
    """Shape of the obstacle. The axis of a cylinder is vertical unless `rpy_deg` tilts it."""
    size: Annotated[tuple[Positive, ...], Field(min_length=1, max_length=3)]
    """Size [m]. Box: length (north at yaw 0), width, height. Cylinder: diameter, height. Sphere: diameter."""
    position: Vector
    """North and east of the centre, and down of the lowest point [m]; D = 0 stands on the floor."""
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw about the centre [deg]."""
    colour: Annotated[str, AfterValidator(_colour)] = DEFAULT_COLOUR
    """Colour in pictures, as `#rrggbb`."""

    def body(self, name: str) -> Body | None:
        """Return the shape and pose of the obstacle as a `Body`. None if `size` has the wrong number of values.

        The cross-checks report wrong sizes.
        """
        if len(self.size) != len(SIZES[self.shape]):
            return None
        size_m = full_size(self.shape, self.size)
        roll, pitch, yaw = (math.radians(angle) for angle in self.rpy_deg)
        up = half_extents(self.shape, size_m, (roll, pitch, yaw))[2]
        north, east, down = self.position
        return Body(
            name=name,
            shape=self.shape,
            size_m=size_m,
            centre_n=(north, east, down - up),
            rpy_rad=(roll, pitch, yaw),
            colour=self.colour,
        )
