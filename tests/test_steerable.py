import math

import numpy as np
import orbits
import pytest
import torch
import torch.nn.functional as F
from orbits import band_limited, best_angle, fourier, orbit, peak, sample, turn
from scipy.special import jn_zeros, jv

from gem_lite import steerable
from gem_lite.se2 import angle_bins
from gem_lite.steerable import SteerableKernel, correlation, disc, harmonics
from gem_lite.steerable.correlation import continued, correlate


def angles_of(count: int) -> torch.Tensor:
    return torch.from_numpy(angle_bins(count))


def analytic_kernel(size: int, channels: int, orders: int, angles: np.ndarray) -> torch.Tensor:
    """Band-limited kernels (angles, channels, size, size) float64 by a formula of their own, turned by formula.

    They are sums of J_m(z r / R) cos(m phi - shift).
    """
    rng = np.random.default_rng(0)
    radius = (size + 1) / 2
    offset = np.arange(size) - size // 2
    r, phi = np.hypot(offset[:, None], offset), np.arctan2(-offset[:, None], offset)
    kernels = np.zeros((len(angles), channels, size, size))
    for channel in range(channels):
        for m in range(orders + 1):
            for zero in jn_zeros(m, 3)[jn_zeros(m, 3) <= np.pi * radius]:
                wave = np.cos(m * (phi - angles[:, None, None]) - rng.uniform(0, 2 * np.pi))
                kernels[:, channel] += (r < radius) * rng.normal() * jv(m, zero * r / radius) * wave
    return torch.from_numpy(kernels)


@pytest.mark.parametrize(
    ("size", "shape", "channels", "orders", "rotations"),
    [(33, (64, 48), 3, 8, 36), (17, (41, 40), 1, 8, 36), (9, (20, 33), 2, 5, 30)],
)
def test_equals_a_kernel_turned_by_formula(size, shape, channels, orders, rotations):
    # The reference turns the kernel analytically in float64, then correlates; ours is float32.
    features = torch.randn(1, channels, *shape, dtype=torch.float64)
    angles = angles_of(rotations)
    stack = analytic_kernel(size, channels, orders, angles.numpy())
    reference = F.conv2d(features, stack, padding=size // 2)
    lifted = SteerableKernel.lift(stack[:1].float(), 180, orders)
    found = sample(lifted.correlate(features.float()), angles.float())
    assert (found - reference).norm() / reference.norm() < 1e-4
    # A sign wrong in the lift, or a kernel one bin off, is seen.
    flipped = sample(SteerableKernel(lifted.coefficients.conj()).correlate(features.float()), angles.float())
    assert (flipped - reference).norm() / reference.norm() > 0.1
    assert (found.roll(1, dims=1) - reference).norm() / reference.norm() > 0.1


@pytest.mark.parametrize("size", [1, 3, 5, 17, 33])
def test_band_limiting_is_a_projection(size):
    kernel = torch.randn(50, 3, size, size, dtype=torch.float64)
    kept = band_limited(kernel)
    assert torch.allclose(band_limited(kept), kept, atol=1e-12)
    assert kept[..., ~disc(size)].abs().sum() == 0
    share = float((kept**2).sum() / (kernel[..., disc(size)] ** 2).sum())
    orders, analysis, synthesis = harmonics(size)
    assert share == pytest.approx(len(orders) / int(disc(size).sum()), abs=0.05)
    assert np.allclose(synthesis @ analysis.T, np.eye(len(orders)), atol=1e-10)  # coefficients to pixels and back
    assert ((kernel - kept) * kept)[..., disc(size)].sum().abs() < 1e-9 * float((kernel**2).sum())  # least squares


def test_turning_composes_and_agrees_with_pixels_at_quarter_turns():
    kernel = band_limited(torch.randn(1, 2, 17, 17, dtype=torch.float64))
    angles = torch.tensor([0.3, 1.1, math.pi / 2], dtype=torch.float64)
    one, two, quarter = turn(kernel, angles)[0].unsqueeze(1)
    assert torch.allclose(turn(one, angles[1:2])[:, 0], turn(kernel, angles[:2].sum()[None])[:, 0], atol=1e-12)
    assert torch.allclose(quarter, torch.rot90(kernel, 1, dims=(-2, -1)), atol=1e-12)
    assert not torch.allclose(two, one, atol=0.1)


@pytest.mark.parametrize(("rotations", "frequency"), [(8, 3), (36, 8), (180, 8), (181, 40)])
def test_lift_is_the_fourier_transform_of_the_orbit(rotations, frequency):
    # One linear map against the explicit orbit, also where few rotations alias.
    kernel = torch.randn(2, 3, 17, 17, dtype=torch.float64)
    slow = fourier(orbit(kernel, rotations), frequency)
    assert torch.allclose(SteerableKernel.lift(kernel, rotations, frequency).coefficients, slow, atol=1e-12)


def test_turning_the_kernel_multiplies_coefficients():
    kernel = torch.randn(1, 2, 9, 9, dtype=torch.float64)
    lifted = SteerableKernel.lift(kernel, 36, 8)
    direct = SteerableKernel.lift(torch.rot90(kernel, 1, dims=(-2, -1)), 36, 8)
    assert torch.allclose(lifted.turned(math.pi / 2).coefficients, direct.coefficients, atol=1e-10)
    assert not torch.allclose(lifted.turned(-math.pi / 2).coefficients, direct.coefficients, atol=1e-3)


@pytest.mark.parametrize(("shape", "size"), [((24, 20), 17), ((33, 33), 9), ((10, 7), 5), ((5, 6), 9), ((8, 8), 1)])
@pytest.mark.parametrize(("batch", "channels"), [(1, 1), (2, 3)])
def test_correlation_by_fft_equals_sums(shape, size, batch, channels):
    # Even and odd maps, also smaller than the kernel; torch's convolution is a plain cross-correlation.
    features = torch.randn(batch, channels, *shape, dtype=torch.float64)
    coefficients = torch.randn(batch, 4, channels, size, size, dtype=torch.complex128)
    found = SteerableKernel(coefficients).correlate(features)
    for one, kernel, response in zip(features, coefficients, found, strict=True):
        slow = [F.conv2d(one[None], part, padding=size // 2) for part in (kernel.real, kernel.imag)]
        assert torch.allclose(response, torch.complex(*slow)[0], atol=1e-11)


def test_blocks_of_frequencies_do_not_matter(monkeypatch):
    kernel, features = torch.randn(1, 2, 9, 9, dtype=torch.float64), torch.randn(1, 2, 24, 20, dtype=torch.float64)

    def run():
        kernel.requires_grad_(), features.requires_grad_()
        response = SteerableKernel.lift(kernel, 36, 8).correlate(features)
        return response, *torch.autograd.grad(response.abs().sum(), (kernel, features))

    plain = run()
    monkeypatch.setattr(correlation, "BLOCK", 1)
    for one, other in zip(plain, run(), strict=True):
        assert torch.allclose(one, other, atol=1e-11)


def test_best_angle_is_the_highest_point_of_the_signal():
    response = torch.randn(50, 9, dtype=torch.complex128)
    found = best_angle(response)
    assert found.shape == (50,)
    grid = response.T[None, :, :, None]  # as (1, K+1, H, W)
    highest = sample(grid, torch.linspace(0, 2 * math.pi, 5001, dtype=torch.float64))[0, :, :, 0].amax(dim=0)
    assert (sample(grid, found)[0, :, :, 0].diagonal() >= highest - 1e-9).all()
    assert best_angle(torch.tensor([1.0 + 0j, 0, 0])) == 0


@pytest.mark.parametrize("count", [1, 36, 360])
def test_peak_is_the_argmax_of_all_samples(count):
    angles = angles_of(count)
    for seed in range(5):
        generator = torch.Generator().manual_seed(seed)
        response = torch.randn(5, 23, 17, dtype=torch.complex128, generator=generator)
        logits = sample(response[None], angles)[0].numpy()
        assert peak(response, angles) == tuple(map(int, np.unravel_index(logits.argmax(), logits.shape)))


def test_peak_is_found_where_rounding_lifts_a_signal_above_its_bound():
    for seed in range(20):
        waves = torch.rand(9, generator=torch.Generator().manual_seed(seed)) + 0.1
        response = torch.zeros(9, 3, 4, dtype=torch.complex64)
        response[:, 2, 1] = waves  # all crests at the angle 0
        assert peak(response, angles_of(36)) == (0, 2, 1)


def test_gradients_equal_those_of_rotating_first():
    kernel = torch.randn(1, 2, 17, 17, dtype=torch.float64, requires_grad=True)
    features = torch.randn(1, 2, 24, 21, dtype=torch.float64, requires_grad=True)
    angles = angles_of(12)
    upstream = torch.randn(1, 12, 24, 21, dtype=torch.float64)
    # Frequency 22 is the highest that a kernel of 17 pixels holds, so nothing is cut off.
    ours = sample(SteerableKernel.lift(kernel, 180, 22).correlate(features), angles)
    slow = F.conv2d(features, turn(kernel, angles)[0], padding=8)
    assert torch.allclose(ours, slow, atol=1e-10)
    found = torch.autograd.grad((ours * upstream).sum(), (kernel, features))
    expected = torch.autograd.grad((slow * upstream).sum(), (kernel, features))
    for one, other in zip(found, expected, strict=True):
        assert torch.allclose(one, other, atol=1e-9)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_plain_kernels_are_correlated_each_alone(count):
    features, kernels = torch.randn(2, 3, 20, 13), torch.randn(2, count, 3, 7, 7)
    expected = torch.stack([F.conv2d(f[None], k, padding=3)[0] for f, k in zip(features, kernels, strict=True)])
    assert correlate(features, kernels).shape == (2, count, 20, 13)
    assert torch.allclose(correlate(features, kernels), expected, atol=1e-4)
    small = (torch.randn(1, 2, 5, 4, dtype=torch.float64), torch.randn(1, count, 2, 3, 3, dtype=torch.float64))
    assert torch.autograd.gradcheck(correlate, [tensor.requires_grad_() for tensor in small])
    assert torch.autograd.gradcheck(lambda f: correlate(f, small[1].detach()), small[:1])
    assert torch.autograd.gradcheck(lambda k: correlate(small[0].detach(), k), small[1:])
    with pytest.raises(ValueError, match=r"features must be \(2, 3, H, W\)"):
        correlate(features[:1], kernels)


def test_features_go_on_beyond_the_border():
    features, kernels = torch.randn(2, 3, 20, 13), torch.randn(2, 2, 3, 7, 7)
    response = continued(lambda whole: correlate(whole, kernels), features, 3)
    padded = F.pad(features, (3, 3, 3, 3), mode="replicate")
    expected = torch.stack([F.conv2d(f[None], k)[0] for f, k in zip(padded, kernels, strict=True)])
    assert torch.allclose(response, expected, atol=1e-4)
    assert torch.equal(continued(lambda whole: whole + 1, features, 0), features + 1), "a kernel of one pixel"
    inside = (..., slice(3, -3), slice(3, -3))
    assert torch.allclose(response[inside], correlate(features, kernels)[inside], atol=1e-4)
    # Of equal features everywhere, no cell is better than another; with zeros beyond the border, a corner is.
    equal = torch.ones(1, 3, 20, 13)
    low = -kernels[:1].abs()
    flat = continued(lambda whole: correlate(whole, low), equal, 3)
    assert torch.allclose(flat, flat[..., 10:11, 6:7].expand_as(flat), rtol=1e-4)
    assert correlate(equal, low)[0, 0].argmax() in (0, 12, 19 * 13, 19 * 13 + 12)


def test_training_after_a_decision():
    # A decision in inference mode fills the tables that training uses next.
    kernel, features = torch.randn(1, 1, 7, 7), torch.randn(1, 1, 9, 9)
    steerable._lift_map.cache_clear(), orbits._turning.cache_clear()
    with torch.inference_mode():
        SteerableKernel.lift(kernel, 20, 3).correlate(features)
        turn(kernel, torch.zeros(1))
    kernel.requires_grad_()
    (SteerableKernel.lift(kernel, 20, 3).correlate(features).abs().sum() + turn(kernel, torch.ones(1)).sum()).backward()
    assert kernel.grad.abs().sum() > 0


def test_bad_arguments_are_named():
    for kernel in (torch.zeros(1, 1, 4, 4), torch.zeros(1, 1, 3, 5), torch.zeros(3, 3)):
        for call in (lambda k: orbit(k, 8), lambda k: SteerableKernel.lift(k, 8, 2), band_limited):
            with pytest.raises(ValueError, match="odd h"):
                call(kernel)
    for frequency in (4, 5, -1):
        with pytest.raises(ValueError, match=rf"frequency must be in \[0, 8/2\) for 8 rotations, got {frequency}"):
            SteerableKernel.lift(torch.zeros(1, 1, 3, 3), 8, frequency)
    with pytest.raises(ValueError, match="frequency"):
        fourier(torch.zeros(1, 8, 1, 3, 3), 4)
    with pytest.raises(ValueError, match="features"):
        SteerableKernel.lift(torch.zeros(1, 2, 3, 3), 8, 2).correlate(torch.zeros(1, 3, 8, 8))
