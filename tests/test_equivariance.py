"""Every equation of A.8 and A.9, and for each a version with a sign or an order wrong, which must fail."""

import math

import equivariance as eq
import numpy as np
import pytest
import torch
import torch.nn.functional as F
from orbits import band_limited, orbit, sample, turn
from torch import nn

from gem_lite.policies.networks import CropKernel
from gem_lite.steerable import SteerableKernel

N = 12
QUARTERS = [0, 3, 6, 9]
ASYMMETRIC = [j for j in range(N) if j not in (0, 6)]
"""Where g and its inverse differ, so that a flipped sign must show."""
ANGLES = 2 * math.pi * torch.arange(N, dtype=torch.float64) / N


def picture(channels, size, seed=0, spread=0.35):
    """(1, channels, size, size) float64: smooth, without symmetry, inside the disc."""
    generator = torch.Generator().manual_seed(seed)
    axis = torch.arange(size, dtype=torch.float64) - size // 2
    blobs = torch.zeros(1, channels, size, size, dtype=torch.float64)
    for channel in range(channels):
        for _ in range(4):
            row, col = (torch.rand(2, generator=generator, dtype=torch.float64) - 0.5) * size * spread
            weight = 0.5 + torch.rand(1, generator=generator, dtype=torch.float64)
            square = (axis[:, None] - row) ** 2 + (axis[None, :] - col) ** 2
            blobs[0, channel] += weight * torch.exp(-square / (2 * 1.8**2))
    return band_limited(blobs)


@pytest.fixture(scope="module")
def kernel():
    return picture(2, 17)


@pytest.fixture(scope="module")
def features():
    return picture(2, 41, seed=1, spread=0.3)


def steerable(kernel, angles=ANGLES, wrong=False):
    lifted = SteerableKernel.lift(kernel, 180, 5)
    if wrong:  # It turns the other way.
        lifted = SteerableKernel(lifted.coefficients.conj())
    return lambda features: sample(lifted.correlate(features), angles.to(features))


def holds(errors, loose=1e-3):
    assert errors.shape[-1] == N
    assert errors[..., QUARTERS].max() < 1e-10
    assert errors.max() < loose


def fails(errors):
    assert errors[ASYMMETRIC].min() > 0.05


def backwards(image, angle):
    return eq.by_harmonics(image, -angle)


def test_pictures_turn_counter_clockwise_both_ways():
    spot = torch.zeros(1, 1, 9, 9, dtype=torch.float64)
    spot[..., 4, 7] = 1.0  # right
    for turn_by in (eq.by_pixels, eq.by_harmonics):
        assert divmod(int(turn_by(spot, math.pi / 2).argmax()), 9) == (1, 4)  # up
    smooth = picture(1, 17)
    assert eq.relative_error(eq.by_pixels(smooth, 0.7), eq.by_harmonics(smooth, 0.7)) < 0.05


def test_representations():
    # A.8.1: rho_reg moves coordinates on by one; a Fourier transform makes rho_irrep of it.
    signal = torch.randn(1, 8, 1, 1, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    assert eq.regular(signal, 1)[0, :, 0, 0].tolist() == [signal[0, -1, 0, 0], *signal[0, :-1, 0, 0].tolist()]
    spectrum = torch.fft.fft(signal, dim=1, norm="forward")[:, :4]
    shifted = torch.fft.fft(eq.regular(signal, 3), dim=1, norm="forward")[:, :4]
    assert torch.allclose(shifted, eq.irreducible(spectrum, 2 * math.pi * 3 / 8))
    assert not torch.allclose(shifted, eq.irreducible(spectrum, -2 * math.pi * 3 / 8), atol=0.01)


@pytest.mark.parametrize("check", [eq.steerability_errors, eq.lemma_1_errors])
def test_eq_8_and_lemma_1(check, kernel):
    stack = orbit(kernel, N)
    holds(check(stack, eq.by_harmonics), 1e-10)
    holds(check(stack), 0.05)  # bicubic interpolation is the error here
    # An orbit that runs the other way round is not this regular type.
    fails(check(stack.flip(1).roll(1, dims=1)))


def test_lemma_2(kernel, features):
    holds(eq.lemma_2_errors(kernel, features, N, eq.by_harmonics))
    # Turning kernel and features against each other breaks it.

    def against(image, angle):
        return eq.by_harmonics(image, -angle if image.shape[-1] == kernel.shape[-1] else angle)

    fails(eq.lemma_2_errors(kernel, features, N, against))


def test_a_9_3(kernel):
    holds(eq.lift_errors(kernel, N, eq.by_harmonics), 1e-10)
    holds(eq.irrep_errors(kernel, N, 5, eq.by_harmonics), 1e-10)
    fails(eq.lift_errors(kernel, N, backwards))
    fails(eq.irrep_errors(kernel, N, 5, backwards))


def unrotated(kernel):
    return lambda features: F.conv2d(features, kernel, padding=8).expand(-1, N, -1, -1)


def ordinary_cnn():
    torch.manual_seed(0)
    return nn.Sequential(nn.Conv2d(2, 8, 9, padding=4), nn.ReLU(), nn.Conv2d(8, N, 9, padding=4)).double()


def test_proposition_1(kernel, features):
    holds(eq.proposition_1_errors(steerable(kernel), features, N, eq.by_harmonics))
    for network in (steerable(kernel, wrong=True), ordinary_cnn(), unrotated(kernel)):
        fails(eq.proposition_1_errors(network, features, N))


def test_proposition_1_does_not_see_a_half_turn_but_an_impulse_does(kernel, features):
    # Convolution instead of correlation is a half turn of the kernel, which commutes with every turn.
    convolution = steerable(turn(kernel, torch.tensor([math.pi], dtype=torch.float64))[:, 0])
    holds(eq.proposition_1_errors(convolution, features, N, eq.by_harmonics))
    impulse = torch.zeros(1, 2, 41, 41, dtype=torch.float64)
    impulse[..., 20, 20] = 1.0
    around = (..., slice(12, 29), slice(12, 29))
    expected = orbit(kernel, N).sum(dim=2).flip(-2, -1)
    assert (steerable(kernel)(impulse)[around] - expected).norm() < 0.1 * expected.norm()
    assert (convolution(impulse)[around] - expected).norm() > 0.2 * expected.norm()


def test_eq_5_only_the_object_moves(kernel):
    # Neighbours stay, out of the kernel's reach; the object turns and goes elsewhere.
    background = torch.zeros(1, 2, 71, 90, dtype=torch.float64)
    background[..., 50:67, 4:21] = picture(2, 17, seed=3)
    background[..., 2:19, 66:83] = picture(2, 17, seed=4)
    item = picture(2, 33, seed=5, spread=0.2)
    motion = {"start": (20, 20), "goal": (50, 66), "rotations": N, "turn_by": eq.by_harmonics}
    holds(eq.local_errors(steerable(kernel), background, item, **motion))
    for network in (steerable(kernel, wrong=True), ordinary_cnn()):
        fails(eq.local_errors(network, background, item, **motion))


def test_eq_5_the_best_pixel_and_angle_move_with_the_object(kernel):
    background = torch.zeros(1, 2, 71, 90, dtype=torch.float64)
    background[..., 50:67, 4:21] = 0.5 * picture(2, 17, seed=3)
    respond = steerable(kernel)

    def best(j, row, col):
        scene = background.clone()
        scene[..., row - 8 : row + 9, col - 8 : col + 9] += turn(kernel, ANGLES[j : j + 1])[:, 0]
        return tuple(int(i) for i in np.unravel_index(int(respond(scene)[0].argmax()), (N, 71, 90)))

    assert best(0, 20, 20) == (0, 20, 20)
    for j, row, col in ((1, 20, 20), (5, 31, 60), (9, 40, 70)):
        assert best(j, row, col) == (j, row, col)


@pytest.fixture(scope="module")
def generator():
    torch.manual_seed(0)
    net = CropKernel(5, 2, 2).double().eval()
    for parameter in net.parameters():
        nn.init.normal_(parameter, std=0.2)
    return net


def test_the_place_kernel_turns_with_its_crop(generator):
    # e2cnn's sense of rotation is ours, and its fields are trivial: quarter turns exact, C_8 nearly.
    crop = picture(5, 17)
    errors = eq.generator_errors(generator, crop, 8)
    assert errors[[0, 2, 4, 6]].max() < 1e-5
    assert errors.max() < 0.25
    assert eq.generator_errors(lambda c: generator(c).flip(-1), crop, 8)[2] > 0.5
    for angle in (math.pi / 2, math.pi / 4):
        assert eq.relative_error(generator(eq.by_pixels(crop, angle)), eq.by_pixels(generator(crop), -angle)) > 0.5


def test_eq_6_goal_and_object_turn_on_their_own(generator, features):
    crop = picture(5, 17)

    def place(goal, picked):
        return steerable(generator(picked))(goal)

    errors = eq.bi_equivariance_errors(place, features, crop, N, eq.by_harmonics)
    assert errors.shape == (N, N)
    assert errors[np.ix_(QUARTERS, QUARTERS)].max() < 1e-5
    assert errors[:, QUARTERS].max() < 0.01  # the goal may turn by any angle; the crop's net knows C_8 only

    # Did the kernel not see how the object lies, or turn against it, every object at a quarter turn would show it.
    def unseen(goal, picked):
        return steerable(generator(crop), ANGLES[QUARTERS])(goal)

    def against(goal, picked):
        return steerable(generator(picked).flip(-1), ANGLES[QUARTERS])(goal)

    for wrong in (unseen, against):
        assert eq.bi_equivariance_errors(wrong, features, crop, 4, eq.by_harmonics)[:, [1, 3]].min() > 0.05


def test_errors_are_relative_and_masked():
    one = torch.ones(1, 1, 9, 9)
    corner = one.clone()
    corner[..., 0, 0] = 100.0
    assert eq.relative_error(corner, one) == 0
    assert eq.relative_error(2 * one, one) == pytest.approx(1.0)
