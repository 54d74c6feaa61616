"""Seconds and memory of a steerable correlation against rotating the kernel first.

    python -m experiments.speed.steerable            # some minutes on 2 cores
    python -m experiments.speed.steerable --quick    # the kernels of 17 and 33 pixels at 72 angles only

*rotate first*: the kernel is turned to every angle by bilinear interpolation, then one conv2d correlates
all of them. *ours*: kernel to Fourier coefficients, correlation by FFT, sampling. Both are differentiated
with respect to kernel and features. Memory is the growth of the process while it works, at its highest,
measured in a process of its own (Linux only).
"""

import argparse
import ctypes
import multiprocessing
import warnings
from pathlib import Path

import torch
import torch.nn.functional as F

from experiments.speed.timing import seconds
from gem_lite.se2 import angle_bins, rotate_image
from gem_lite.steerable import SteerableKernel, disc
from gem_lite.steerable.correlation import sample_parts

warnings.filterwarnings("ignore", message="TF32")  # on other hardware, says torch whenever oneDNN is switched

CHANNELS = 3
LIFTED = 180
CASES = (((160, 80), 17), ((320, 160), 33), ((320, 160), 65))
FREQUENCIES = (8, 16, 36)
ANGLES = (36, 72, 180)


def work(shape: tuple[int, int], size: int, count: int, frequency: int | None):
    """Two functions: forward, and forward+backward; ``frequency`` None is *rotate first*."""
    generator = torch.Generator().manual_seed(0)
    kernel = torch.randn(1, CHANNELS, size, size, generator=generator) * disc(size)
    features = torch.randn(1, CHANNELS, *shape, generator=generator)
    angles = torch.from_numpy(angle_bins(count)).float()
    upstream = torch.randn(1, count, *shape)

    def forward():
        """(1, R, H, W): the correlation at each angle."""
        if frequency is None:
            # oneDNN takes minutes for large kernels: these are torch's own matrix product.
            with torch.backends.mkldnn.flags(enabled=size <= 33):
                return F.conv2d(features, rotate_image(kernel, angles), padding=size // 2)
        return sample_parts(SteerableKernel.lift(kernel, LIFTED, frequency).correlate_parts(features), angles)

    def training():
        kernel.requires_grad_(), features.requires_grad_()
        with torch.backends.mkldnn.flags(enabled=size <= 33):
            forward().backward(upstream)

    return torch.no_grad()(forward), training


def _grown(queue, shape: tuple[int, int], size: int, count: int, frequency: int | None) -> None:
    """Megabytes by which this process grows at its highest while it trains one step."""
    work((32, 32), 9, 4, frequency)[1]()  # libraries load
    training = work(shape, size, count, frequency)[1]
    if frequency is not None:
        SteerableKernel.lift(torch.zeros(1, CHANNELS, size, size), LIFTED, frequency)  # tables are made
    ctypes.CDLL(None).malloc_trim(0)  # what was freed goes back, so that it does not hide the growth
    Path("/proc/self/clear_refs").write_text("5")  # forget the highest mark
    before = _status("VmRSS")
    training()
    queue.put(_status("VmHWM") - before)


def _status(key: str) -> float:
    """A figure of this process, in megabytes."""
    return int(Path("/proc/self/status").read_text().split(f"{key}:")[1].split()[0]) / 1024


def megabytes(*case) -> float:
    """`_grown` in a fresh process."""
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    process = context.Process(target=_grown, args=(queue, *case))
    process.start()
    grown = queue.get()
    process.join()
    return grown


def main() -> None:
    """Print times, memory and ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="kernels of 17 and 33 pixels, 72 angles")
    quick = parser.parse_args().quick
    print(f"{torch.get_num_threads()} threads, {CHANNELS} channels; ratios are rotate first / ours")
    for shape, size in CASES[: 2 if quick else None]:
        # 72 kernels of 65 pixels take seconds by conv2d: two runs are enough there.
        long = size > 33
        runs = 2 if long else 5
        for count in (72,) if quick or long else ANGLES:
            slow = [seconds(step, runs)[0] for step in work(shape, size, count, None)]
            space = megabytes(shape, size, count, None)
            print(f"\n{shape[0]} x {shape[1]}, h = {size}, {count} angles; forward, with gradients, memory")
            print(f"  rotate first  {slow[0] * 1e3:8.1f} ms {slow[1] * 1e3:8.1f} ms {space:5.0f} MB")
            for frequency in FREQUENCIES:
                fast = [seconds(step, runs)[0] for step in work(shape, size, count, frequency)]
                used = megabytes(shape, size, count, frequency)
                print(
                    f"  ours, K = {frequency:2d}  {fast[0] * 1e3:8.1f} ms {fast[1] * 1e3:8.1f} ms {used:5.0f} MB;"
                    f"  ratios {slow[0] / fast[0]:5.1f}, {slow[1] / fast[1]:5.1f}, memory {space / used:4.1f}"
                )


if __name__ == "__main__":
    main()
