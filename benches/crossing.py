"""The crossing engine against one written in NumPy, in one run: python benches/crossing.py

Sequences of a moving texture, 240 x 180, 200 frames, one thread; prints medians of interleaved repetitions and ratios.
"""

import os
import statistics
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import numpy.typing as npt

import davis_rs

WIDTH, HEIGHT, FRAMES, REPETITIONS = 240, 180, 200, 5
STEPS = {"dense, 1/3 px a frame": 1 / 3, "quiet, 0.02 px a frame": 0.02, "static": 0.0}


def sequence(step_px: float) -> npt.NDArray[np.float32]:
    """A random texture of waves of 8 to 128 px (amplitude 1/f, 0.6 rms in log), moved exactly, by a Fourier shift."""
    size = 256
    random = np.random.Generator(np.random.PCG64(12345))
    fy, fx = np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None]
    f = np.hypot(fx, fy)
    amplitude = np.where((f >= 1 / 128) & (f <= 1 / 8), 1 / np.maximum(f, 1e-9), 0.0)
    spectrum = amplitude * np.exp(2j * np.pi * random.random(f.shape))
    texture = np.fft.irfft2(spectrum, s=(size, size))
    scale = 0.6 / texture.std()
    frames = []
    for k in range(FRAMES):
        shift = np.exp(-2j * np.pi * (fx * k * step_px + fy * k * step_px * 0.4))
        log = np.fft.irfft2(spectrum * shift, s=(size, size))[:HEIGHT, :WIDTH] * scale - texture.max() * scale - 1e-3
        frames.append(np.exp(log).astype(np.float32))
    return np.stack(frames)


class NumpyEngine:
    """What a researcher writes by hand: vectorised, float64, events sorted in each frame; not exact."""

    def __init__(self, contrast_threshold: float = 0.15, log_eps: float = 1e-3) -> None:
        self.c, self.log_eps = contrast_threshold, log_eps
        self.t_us = -1

    def push(self, t_us: int, luma: npt.NDArray[np.float32]) -> int:
        log = np.log(luma.astype(np.float64) + self.log_eps)
        if self.t_us < 0:
            self.reference, self.log, self.t_us = log.copy(), log, t_us
            return 0
        steps = np.trunc((log - self.reference) / self.c).astype(np.int64)
        y, x = np.nonzero(steps)
        k = steps[y, x]
        count, sign = np.abs(k), np.sign(k)
        i = np.repeat(np.arange(len(count)), count)
        step = np.arange(len(i)) - np.repeat(np.cumsum(count) - count, count) + 1
        before, after = self.log[y, x][i], log[y, x][i]
        fraction = (self.reference[y, x][i] + sign[i] * step * self.c - before) / (after - before)
        t = self.t_us + np.ceil(fraction * (t_us - self.t_us)).astype(np.int64)
        order = np.lexsort((x[i], y[i], t))
        events = (t[order], x[i][order], y[i][order], sign[i][order] > 0)
        self.reference[y, x] += k * self.c
        self.log, self.t_us = log, t_us
        return len(events[0])


class OurEngine:
    def __init__(self) -> None:
        self.engine = davis_rs.CrossingEngine(WIDTH, HEIGHT, threads=1)

    def push(self, t_us: int, luma: npt.NDArray[np.float32]) -> int:
        return len(self.engine.push(t_us, luma))


def run(engine: NumpyEngine | OurEngine, frames: npt.NDArray[np.float32]) -> tuple[float, int]:
    """(seconds, events) of a whole sequence."""
    start = time.perf_counter()
    events = sum(engine.push(1000 * k, frame) for k, frame in enumerate(frames))
    return time.perf_counter() - start, events


def main() -> None:
    print("| sequence | events a pixel a frame | NumPy, Mpixel/s | davis_rs, Mpixel/s | ratio |")
    print("|---|---|---|---|---|")
    for name, step_px in STEPS.items():
        frames = sequence(step_px)
        theirs, ours = [], []
        for _ in range(REPETITIONS):
            theirs.append(run(NumpyEngine(), frames))
            ours.append(run(OurEngine(), frames))
        ratio = statistics.median(a[0] / b[0] for a, b in zip(theirs, ours, strict=True))
        speed = [frames.size / statistics.median(seconds for seconds, _ in runs) / 1e6 for runs in (theirs, ours)]
        density = ours[0][1] / frames.size
        print(f"| {name} | {density:.3f} | {speed[0]:.1f} | {speed[1]:.0f} | {ratio:.1f} x |")


if __name__ == "__main__":
    main()
