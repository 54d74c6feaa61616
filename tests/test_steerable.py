import math

import pytest
import torch

from gem_lite.se2 import rotate_image
from gem_lite.steerable import SteerableKernel, disc, fourier, orbit, radius, sample

H = 9


def smooth_kernel(channels: int = 2, size: int = H, seed: int = 0) -> torch.Tensor:
    """A few Gaussian bumps: band-limited enough to survive interpolation."""
    generator = torch.Generator().manual_seed(seed)
    axis = torch.arange(size, dtype=torch.float64) - (size - 1) / 2
    rows, cols = torch.meshgrid(axis, axis, indexing="ij")
    kernel = torch.zeros(1, channels, size, size, dtype=torch.float64)
    for channel in range(channels):
        for _ in range(3):
            r, c = (torch.rand(2, generator=generator, dtype=torch.float64) - 0.5) * size * 0.5
            weight = torch.randn(1, generator=generator, dtype=torch.float64)
            kernel[0, channel] += weight * torch.exp(-((rows - r) ** 2 + (cols - c) ** 2) / (2 * (size / 6) ** 2))
    return kernel * disc(size)


def test_orbit_is_regular_type():
    # Lemma 1: T_g Psi = rho_reg(g^-1) Psi, where (rho_reg(g_j) Psi)_i = Psi_{i-j}. Exact at quarter turns.
    kernel = smooth_kernel()
    turned = orbit(torch.rot90(kernel, 1, dims=(-2, -1)), 8)
    assert torch.allclose(turned, orbit(kernel, 8).roll(-2, dims=1), atol=1e-12)
    assert not torch.allclose(turned, orbit(kernel, 8).roll(2, dims=1), atol=1e-3)


def test_orbit_turns_counter_clockwise():
    kernel = torch.zeros(1, 1, 5, 5)
    kernel[0, 0, 2, 4] = 1.0  # right of the centre
    quarter = orbit(kernel, 4)[0, 1, 0]
    assert quarter[0, 2] == pytest.approx(1.0, abs=1e-6)  # now above it


def test_fourier_inverts_up_to_its_frequency():
    kernel = smooth_kernel()
    stack = orbit(kernel, 16)
    coefficients = fourier(stack, 7)
    angles = 2 * math.pi * torch.arange(16, dtype=torch.float64) / 16
    flat = coefficients[:, :, 0]  # (1, K+1, h, h), as if it were a response
    error = (sample(flat, angles) - stack[:, :, 0]).abs().max() / stack.abs().max()
    assert error < 0.05  # what lies above frequency 7, and the terms that a radius cannot carry


def test_no_angular_signal_where_none_can_be():
    coefficients = fourier(orbit(torch.randn(1, 1, H, H), 36), 12)
    assert coefficients[:, 1:, :, H // 2, H // 2].abs().max() == 0
    k = torch.arange(13)[:, None, None]
    assert coefficients[0, :, 0][k > math.pi * radius(H)].abs().max() == 0


def test_turning_the_kernel_multiplies_coefficients():
    kernel = smooth_kernel()
    lifted = SteerableKernel.lift(kernel, 36, 8)
    direct = SteerableKernel.lift(torch.rot90(kernel, 1, dims=(-2, -1)), 36, 8)
    assert torch.allclose(lifted.turned(math.pi / 2).coefficients, direct.coefficients, atol=1e-10)
    assert not torch.allclose(lifted.turned(-math.pi / 2).coefficients, direct.coefficients, atol=1e-3)


def test_equals_rotate_then_correlate():
    # The slow way: turn the kernel to every angle, then correlate.
    kernel, features = smooth_kernel(size=17), torch.randn(1, 2, 24, 20, dtype=torch.float64)
    angles = 2 * math.pi * torch.arange(36, dtype=torch.float64) / 36
    slow = torch.nn.functional.conv2d(features, orbit(kernel, 36)[0], padding=8)
    fast = sample(SteerableKernel.lift(kernel, 36, 17).correlate(features), angles)
    assert (fast - slow).abs().max() / slow.abs().max() < 0.02


def test_impulse_pins_correlation_against_convolution():
    # Both are equivariant; only an impulse tells them apart: they differ by a half turn.
    kernel = smooth_kernel(channels=1)
    features = torch.zeros(1, 1, 21, 21, dtype=torch.float64)
    features[0, 0, 10, 10] = 1.0
    response = SteerableKernel.lift(kernel, 36, 8).correlate(features).real[0, 0]
    expected = fourier(orbit(kernel, 36), 0).real[0, 0, 0].flip(0, 1)
    assert torch.allclose(response[10 - 4 : 10 + 5, 10 - 4 : 10 + 5], expected, atol=1e-12)
    single = SteerableKernel(kernel[:, None].to(torch.complex128)).correlate(features).real[0, 0]
    assert torch.allclose(single[6:15, 6:15], kernel[0, 0].flip(0, 1), atol=1e-12)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_turning_the_object_moves_the_best_angle_by_as_much(turns):
    # Eq. 5 with an identity for features: the argmax moves with the object, position and angle.
    kernel = smooth_kernel(channels=1)
    scene = torch.zeros(1, 1, 33, 33, dtype=torch.float64)
    scene[0, 0, 6 : 6 + H, 14 : 14 + H] = kernel[0, 0]
    angles = 2 * math.pi * torch.arange(36, dtype=torch.float64) / 36
    lifted = SteerableKernel.lift(kernel, 36, 8)

    def best(picture):
        logits = sample(lifted.correlate(picture), angles)[0]
        i, rest = divmod(int(logits.argmax()), 33 * 33)
        return i, *divmod(rest, 33)

    assert best(scene) == (0, 10, 18)
    moved = best(torch.rot90(scene, turns, dims=(-2, -1)))
    row, col = 10 - 16, 18 - 16
    for _ in range(turns):
        row, col = -col, row
    assert moved == (9 * turns, row + 16, col + 16)


def test_angle_follows_a_turned_object_between_the_bins():
    kernel = smooth_kernel(channels=1, size=17)
    lifted = SteerableKernel.lift(kernel, 180, 8)
    fine = 2 * math.pi * torch.arange(720, dtype=torch.float64) / 720
    for degrees in (17.0, 101.0, -64.0):
        turned = rotate_image(kernel, torch.tensor([math.radians(degrees)]))
        logits = sample(lifted.correlate(turned), fine)[0, :, 8, 8]
        found = math.degrees(float(fine[logits.argmax()]))
        assert abs((found - degrees + 180) % 360 - 180) < 1.5


def test_batch_entries_do_not_mix():
    kernels, features = torch.randn(3, 2, 5, 5), torch.randn(3, 2, 16, 12)
    together = SteerableKernel.lift(kernels, 12, 3).correlate(features)
    alone = SteerableKernel.lift(kernels[1:2], 12, 3).correlate(features[1:2])
    assert torch.allclose(together[1:2], alone, atol=1e-5)
    assert together.shape == (3, 4, 16, 12)


def test_gradients():
    kernel = torch.randn(1, 1, 3, 3, dtype=torch.float64, requires_grad=True)
    features = torch.randn(1, 1, 5, 4, dtype=torch.float64, requires_grad=True)
    angles = torch.tensor([0.0, 1.0], dtype=torch.float64)

    def logits(k, f):
        return sample(SteerableKernel.lift(k, 8, 2).correlate(f), angles)

    assert torch.autograd.gradcheck(logits, (kernel, features))


def test_bad_arguments_are_named():
    with pytest.raises(ValueError, match="odd h"):
        orbit(torch.zeros(1, 1, 4, 4), 8)
    with pytest.raises(ValueError, match="frequency"):
        fourier(torch.zeros(1, 8, 1, 3, 3), 4)
    with pytest.raises(ValueError, match="features"):
        SteerableKernel.lift(torch.zeros(1, 2, 3, 3), 8, 2).correlate(torch.zeros(1, 3, 8, 8))
