"""Train a small network that reconstructs intensity from events, on simulated sequences alone.

The script makes images, sequences of planes that carry them (``davis_rs.generate``), and windows of 100 ms with the
frame at their end (``davis_rs.data.torch.EventDataset``). The network is a U-Net that sees the voxel grid of a window
and is asked for the logarithm of that frame, less its mean, which events do not tell. It is judged on sequences with
other images. Needs ``pip install 'davis_rs[torch,view]'``. Run: python examples/train_reconstruction.py -o
reconstruction.png
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image, ImageDraw
from scipy.ndimage import gaussian_filter
from torch import nn
from torch.nn import functional
from tqdm import tqdm

from davis_rs.data.torch import EventDataset, collate
from davis_rs.generate import generate_sequences, load_sequence_plan

WIDTH, HEIGHT, BINS = 96, 72, 10
DARK = 0.02  # added before the logarithm: two percent of white
PLAN = """\
seed: {seed}
sequences: {sequences}
scene:
  kind: random_planes
  textures: images
  planes: {{integers: [1, 4]}}
  top_speed_m_s: {{log_uniform: [0.5, 4]}}
  camera_rate_deg_s: {{log_uniform: [120, 480]}}
size: 96x72
duration: 0.2
frame_rate: 10
depth_rate: 0
contrast_threshold: {{uniform: [0.15, 0.25]}}
accuracy: fast
"""


def draw_images(folder: Path, seed: int, count: int, pixels: int = 256) -> None:
    """Grey images of polygons and ellipses on soft clouds."""
    folder.mkdir(parents=True)
    random = np.random.default_rng(seed)
    for number in range(count):
        clouds = gaussian_filter(random.normal(size=(pixels, pixels)), random.uniform(4, 24), mode="wrap")
        shade = random.uniform(60, 190) + random.uniform(10, 45) * clouds / clouds.std()
        image = Image.fromarray(np.clip(shade, 5, 250).astype(np.uint8))
        pen = ImageDraw.Draw(image)
        for _ in range(int(random.integers(4, 16))):
            grey = int(random.integers(8, 248))
            x, y, size = (*random.uniform(0, pixels, 2).tolist(), random.uniform(0.04, 0.25) * pixels)
            if random.random() < 0.5:
                pen.ellipse((x - size, y - 0.7 * size, x + size, y + 0.7 * size), fill=grey)
            else:
                angles = np.sort(random.uniform(0, 2 * np.pi, int(random.integers(3, 7))))
                pen.polygon([(x + size * np.cos(a), y + size * np.sin(a)) for a in angles], fill=grey)
        image.save(folder / f"{number:03}.png")


def make_windows(folder: Path, seed: int, sequences: int) -> dict[str, torch.Tensor]:
    """Voxel grids (n, BINS, H, W) of windows of 100 ms, and log intensity at their ends (n, 1, H, W), natural units."""
    if not (folder / "images").exists():
        draw_images(folder / "images", seed, max(8, sequences // 2))
    (folder / "plan.yaml").write_text(PLAN.format(seed=seed, sequences=sequences))
    generate_sequences(load_sequence_plan(folder / "plan.yaml"), folder / "data", quiet=True)
    dataset = EventDataset(
        sorted((folder / "data").glob("sequence_*")), by="frames", parameters={"bins": BINS}, images=["frames"]
    )
    batch = collate([dataset[k] for k in range(len(dataset))])
    frames = torch.log(batch["frames"][:, -1:].float() / 255 + DARK)
    return {"events": batch["events"], "frames": without_mean(frames)}


def without_mean(frames: torch.Tensor) -> torch.Tensor:
    return frames - frames.mean((2, 3), keepdim=True)


class Block(nn.Sequential):
    """Two convolutions."""

    def __init__(self, before: int, after: int) -> None:
        super().__init__(
            nn.Conv2d(before, after, 3, padding=1),
            nn.GroupNorm(4, after),
            nn.SiLU(),
            nn.Conv2d(after, after, 3, padding=1),
            nn.SiLU(),
        )


class Network(nn.Module):
    """A U-Net of three scales, each half of the one before."""

    def __init__(self, channels: int = 16) -> None:
        super().__init__()
        sizes = [channels, 2 * channels, 3 * channels, 4 * channels]
        self.down = nn.ModuleList(Block(a, b) for a, b in zip([BINS, *sizes], sizes, strict=False))
        self.up = nn.ModuleList(Block(a + b, b) for a, b in zip(sizes[:0:-1], sizes[-2::-1], strict=True))
        self.last = nn.Conv2d(channels, 1, 1)

    def forward(self, events: torch.Tensor) -> torch.Tensor:
        seen, x = [], events
        for block in self.down:
            x = block(x if not seen else functional.avg_pool2d(x, 2))
            seen.append(x)
        for block, skip in zip(self.up, seen[-2::-1], strict=True):
            wide = functional.interpolate(x, size=skip.shape[2:], mode="bilinear", align_corners=False)
            x = block(torch.cat([wide, skip], 1))
        return without_mean(self.last(x))


def loss_of(found: torch.Tensor, frames: torch.Tensor) -> torch.Tensor:
    """Mean absolute error of log intensity, and of its differences between neighbours, so that edges stay sharp."""
    loss = functional.l1_loss(found, frames)
    for axis in (2, 3):
        loss = loss + functional.l1_loss(found.diff(dim=axis), frames.diff(dim=axis))
    return loss


def train(network: Network, windows: dict[str, torch.Tensor], steps: int, batch: int, rate: float) -> None:
    """AdamW with one cycle of the learning rate; windows are mirrored at random."""
    optimizer = torch.optim.AdamW(network.parameters(), rate)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, rate, total_steps=steps)
    count = len(windows["frames"])
    progress = tqdm(range(steps), desc="training", mininterval=2)
    for _ in progress:
        chosen = torch.randint(count, (batch,))
        mirrored = [axis for axis in (2, 3) if torch.rand(()) < 0.5]
        events, frames = (windows[name][chosen].flip(mirrored) for name in ("events", "frames"))
        loss = loss_of(network(events), frames)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        progress.set_postfix(loss=f"{loss.item():.3f}", refresh=False)


def judged(found: torch.Tensor, frames: torch.Tensor) -> tuple[float, float]:
    """Root mean square error in natural-log units, and the mean correlation of a window with its frame."""
    error = float(((found - frames) ** 2).mean().sqrt())
    a, b = (x.flatten(1) - x.flatten(1).mean(1, keepdim=True) for x in (found, frames))
    correlation = (a * b).sum(1) / (a.norm(dim=1) * b.norm(dim=1)).clamp_min(1e-9)
    return error, float(correlation.mean())


def best_scaled(images: torch.Tensor, frames: torch.Tensor) -> torch.Tensor:
    """Images times the one factor that brings them closest to all frames."""
    return images * (images * frames).sum() / (images * images).sum()


def draw(path: Path, columns: dict[str, torch.Tensor], rows: list[int]) -> None:
    """Windows in rows, what is known of them in columns."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(
        len(rows), len(columns), figsize=(1.95 * len(columns), 1.5 * len(rows) + 0.25), squeeze=False
    )
    for axes_row, row in zip(axes, rows, strict=True):
        for axis, (name, images) in zip(axes_row, columns.items(), strict=True):
            limit = 4 if name == "events, ON - OFF" else 2.5 * float(columns["true frame"][row].std())
            colours = "RdBu_r" if name == "events, ON - OFF" else "gray"
            axis.imshow(images[row, 0].numpy(), cmap=colours, vmin=-limit, vmax=limit)
            axis.set_xticks([]), axis.set_yticks([])
    for axis, name in zip(axes[0], columns, strict=True):
        axis.set_title(name, fontsize=9)
    figure.tight_layout(pad=0.3)
    figure.savefig(path, dpi=130)
    pyplot.close(figure)


def main(argv: list[str] | None = None) -> dict[str, tuple[float, float]]:
    """Returns, for each way to reconstruct, the error in natural-log units and the correlation on held-out windows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sequences", type=int, default=160, help="to train with; a fifth more are held out")
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--batch", type=int, default=8)
    parser.add_argument("--rate", type=float, default=3e-3, help="the highest learning rate")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--data", type=Path, help="where the sequences are kept; what is there is taken")
    parser.add_argument("-o", "--output", type=Path, metavar="PICTURE")
    options = parser.parse_args(argv)
    torch.manual_seed(options.seed)
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.data or Path(temporary)
        windows = make_windows(folder / "training", options.seed, options.sequences)
        held_out = make_windows(folder / "held_out", options.seed + 1, max(4, options.sequences // 5))
    network = Network()
    frames, grids = held_out["frames"], held_out["events"]
    net_events = grids.sum(1, keepdim=True)
    with torch.no_grad():
        ways: dict[str, Any] = {
            "an even grey": torch.zeros_like(frames),
            "events, summed and scaled": best_scaled(without_mean(net_events), frames),
            "network before training": network(grids),
        }
    train(network, windows, options.steps, options.batch, options.rate)
    with torch.no_grad():
        ways["network"] = network(grids)
    print(
        f"{sum(p.numel() for p in network.parameters()):,} parameters, {len(windows['frames'])} windows to train with,"
    )
    print(f"{len(frames)} held-out windows: rms error of log intensity, correlation")
    found = {name: judged(images, frames) for name, images in ways.items()}
    for name, (error, correlation) in found.items():
        print(f"  {name:28} {error:.3f}  {correlation:5.2f}")
    if options.output:
        columns = {"events, ON - OFF": net_events, "network": ways["network"], "true frame": frames}
        draw(options.output, columns, np.linspace(0, len(frames) - 1, 4).astype(int).tolist())
    return found


if __name__ == "__main__":
    main()
