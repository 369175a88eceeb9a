"""A vehicle that signs as PX4 1.18 does."""

import time

from arena.wire.mavlink_frame import parse_frames
from arena.wire.mavlink_signing import FrameSigner, SignatureCheck, Verdict, timestamp_at


class SigningAutopilot:
    """An autopilot with a key. accepted: number of frames that it has obeyed; refused: the other ones, by reason"""

    def __init__(self, inner, key):
        self.inner, self.accepted, self.refused = inner, 0, []
        self._check, self._signer = SignatureCheck(key), FrameSigner(key, 0, timestamp_at(time.time() - 9e6))

    def receive(self, data, now):
        answers = []
        for frame in parse_frames(data).frames:
            verdict = self._check.check(data, frame, self._signer.timestamp)
            if verdict is Verdict.VALID:
                self.accepted += 1
                answers += self.inner.receive(bytes(data[frame.start : frame.end]), now)
            else:
                self.refused.append(verdict)
        self._signer.on_received(self._check.timestamp)
        return [self._signed(answer) for answer in answers]

    def step(self, now):
        return [self._signed(data) for data in self.inner.step(now)]

    def _signed(self, data):
        frames = parse_frames(data).frames
        return b"".join(self._signer.sign(data[f.start : f.end], 0.0) for f in frames)
