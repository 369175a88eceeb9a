import pytest

pytest.importorskip("pybullet", reason="the simulation room needs pybullet")
