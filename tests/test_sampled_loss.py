"""The cross-entropy without stored logits equals the plain one."""

import pytest
import torch

from gem_lite.policies import gem
from gem_lite.policies.gem_config import LITE
from gem_lite.policies.inputs import cross_entropy
from gem_lite.se2 import angle_bins
from gem_lite.steerable.correlation import sample_parts
from gem_lite.steerable.loss import PIXELS, sampled_cross_entropy

ANGLES = torch.tensor(angle_bins(36), dtype=torch.float32)
CELLS = [([3, 7], 10, 20), ([5], 39, 49), (list(range(36)), 0, 0)]


def random_parts(scale, height=40, width=50):
    generator = torch.Generator().manual_seed(0)
    return torch.randn(len(CELLS), 18, height, width, generator=generator) * scale


@pytest.mark.parametrize("scale", [0.01, 1.0, 30.0])
def test_loss_and_gradient_are_those_of_the_plain_cross_entropy(scale):
    response = random_parts(scale)
    assert response[0, 0].numel() > PIXELS  # more than one block
    results = []
    for loss in (
        lambda values: cross_entropy(sample_parts(values, ANGLES), CELLS),
        lambda values: sampled_cross_entropy(values, ANGLES, CELLS),
    ):
        values = response.clone().requires_grad_()
        result = loss(values)
        result.backward()
        results.append((result, values.grad))
    (plain, plain_grad), (fast, fast_grad) = results
    assert fast.item() == pytest.approx(plain.item(), rel=1e-5)
    rounding = 1e-7 * plain.item()  # what single precision makes of a logarithm of this size
    assert torch.allclose(fast_grad, plain_grad, atol=1e-5 * max(1.0, plain_grad.abs().max().item()) + rounding)


def test_a_module_has_the_same_loss_by_both_ways():
    for kernels in ("steerable", "free"):
        config = LITE.ablated("with-free-kernels") if kernels == "free" else LITE
        module = gem.PickModule(config, 16)
        rgbd, semantic, words = torch.randn(2, 4, 160, 80), torch.rand(2, 1, 160, 80), torch.randn(2, 16)
        cells = [([0], 5, 6), ([1, 19], 80, 40)]
        fast = module.loss(module.features(rgbd, semantic, words), module.kernel(words), cells)
        assert fast.item() == pytest.approx(cross_entropy(module(rgbd, semantic, words), cells).item(), rel=1e-5)


@pytest.mark.parametrize("scale", [1.0, 300.0])
def test_raised_logits_change_neither_loss_nor_gradient(scale):
    logits = torch.randn(2, 4, 20, 20, generator=torch.Generator().manual_seed(0)) * scale
    cells = [([0, 2], 3, 4), ([1], 19, 19)]
    results = []
    for double in (False, True):
        values = (logits.double() if double else logits).clone().requires_grad_()
        if double:  # the plain cross-entropy, where nothing underflows
            right = torch.stack(
                [scores[bins, row, col].mean() for scores, (bins, row, col) in zip(values, cells, strict=True)]
            )
            loss = (values.flatten(1).logsumexp(dim=1) - right).mean()
        else:
            loss = cross_entropy(values, cells)
        loss.backward()
        results.append((loss.item(), values.grad.double()))
    (loss, grad), (plain_loss, plain_grad) = results
    assert loss == pytest.approx(plain_loss, rel=1e-5)
    assert torch.allclose(grad, plain_grad, atol=1e-6)
    tiny = torch.finfo(torch.float32).tiny
    assert not ((grad != 0) & (grad.abs() < tiny)).any()  # no number that nearly underflows
