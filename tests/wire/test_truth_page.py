"""The truth page: what is written is what is read, interpolated or not at all."""

from __future__ import annotations

import math
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from arena.errors import RunError, WireError
from arena.geometry import quat_exp, quat_from_euler, quat_multiply
from arena.schema.mocap import Mocap
from arena.wire.truth_page import SPAN_S, Truth, TruthReader, TruthWriter

AXIS = np.array([0.3, -0.5, 0.8])
Q0 = quat_from_euler(np.radians([10.0, -20.0, 35.0]))


def sample(t: float) -> Truth:
    return Truth(
        time_s=t,
        p_n=np.array([[t, 2 * t, -t]]),
        q_nb=quat_multiply(Q0, quat_exp(AXIS * t))[None],
        v_n=np.array([[1.0, 2.0, -1.0]]),
        omega_b=AXIS[None],
        accel_b=np.zeros((1, 3)),
        motors=np.full((1, 4), 0.5),
    )


def test_position_and_attitude_are_interpolated_between_two_samples(tmp_path):
    writer = TruthWriter(tmp_path / "truth", 1, period_s=0.004)
    for k in range(100):
        writer.write(sample(0.004 * k))
    reader = TruthReader(tmp_path / "truth")
    for t in (0.3001, 0.3905, 0.396):
        found = reader.at(t)
        assert found is not None
        assert np.allclose(found.p_n, sample(t).p_n, atol=1e-9)
        assert np.allclose(found.q_nb, sample(t).q_nb, atol=1e-6)
    assert reader.newest().time_s == pytest.approx(0.396)


def test_outputs_of_all_rotors_are_read_back(tmp_path):
    writer = TruthWriter(tmp_path / "truth", 1, period_s=0.004)
    outputs = np.array([[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]])
    writer.write(sample(0.0)._replace(motors=outputs))
    newest = TruthReader(tmp_path / "truth").newest()
    assert newest.motors[0].tolist() == [*outputs[0], 0.0, 0.0]


def test_a_time_outside_the_ring_gives_none(tmp_path):
    writer = TruthWriter(tmp_path / "truth", 1, period_s=0.004)
    reader = TruthReader(tmp_path / "truth")
    assert reader.newest() is None
    assert reader.at(0.0) is None
    count = math.ceil(SPAN_S / 0.004) + 20
    for k in range(count):
        writer.write(sample(0.004 * k))
    assert reader.at(0.01) is None
    assert reader.at(0.004 * count) is None


@pytest.mark.parametrize("hz", [50, 250, 1000])
def test_page_reaches_back_to_the_largest_latency_at_every_rate(tmp_path, hz):
    """A camera reads the exposure one latency later; the schema allows 1 s."""
    latency_s = 1e-3 * next(x.le for x in Mocap.model_fields["latency_ms"].metadata if hasattr(x, "le"))
    assert latency_s == pytest.approx(1.0)
    writer, reader = TruthWriter(tmp_path / "truth", 1, period_s=1 / hz), TruthReader(tmp_path / "truth")
    for k in range(3 * hz):
        writer.write(sample(k / hz))
        exposed = k / hz - latency_s - 0.1  # one frame of the slowest camera, 10 Hz, too late
        if exposed > 0.0:
            found = reader.at(exposed)
            assert found is not None
            assert found.p_n[0, 0] == pytest.approx(exposed)


def test_a_missing_or_foreign_page_is_an_error_in_one_sentence(tmp_path):
    with pytest.raises(RunError, match="is the process `world` running"):
        TruthReader(tmp_path / "truth")
    (tmp_path / "truth").write_bytes(bytes(800))
    with pytest.raises(WireError, match="is not a truth page of this version"):
        TruthReader(tmp_path / "truth")


def test_a_reader_never_finds_an_incomplete_page(tmp_path):
    page = tmp_path / "truth"
    TruthWriter(page, 3, period_s=0.004)
    over = threading.Event()

    def read() -> int:
        found = 0
        while not over.is_set():
            assert TruthReader(page).newest() is None
            found += 1
        return found

    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(read)
        for _ in range(300):
            TruthWriter(page, 3, period_s=0.004)
        over.set()
        assert reading.result() > 0
