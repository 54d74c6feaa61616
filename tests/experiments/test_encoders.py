"""How far features are from turning with their scene."""

import pytest
import torch
from small import small

from experiments.encoders.__main__ import largest_errors, main
from gem_lite import clip
from gem_lite.policies.gem import Gem
from gem_lite.policies.inputs import Inputs


@pytest.mark.parametrize(("encoder", "exact"), [("steerable", True), ("plain", False)])
def test_quarter_turns_are_exact_with_the_steerable_encoder_alone(encoder, exact, model):
    policy = Gem(small("gem", encoder=encoder), model)
    generator = torch.Generator().manual_seed(0)
    inputs = Inputs(
        rgbd=torch.rand(4, 48, 32, generator=generator),
        maps={"pick": torch.rand(1, 48, 32, generator=generator)},
        words={"pick": torch.rand(policy.language_dim, generator=generator)},
    )
    quarter, eighth, _ = largest_errors(policy, inputs, "pick")
    assert (quarter < 1e-5) == exact and eighth > 1e-4


def test_a_policy_of_another_table_is_refused(monkeypatch):
    checkpoint = str(clip.DATA / "gem-object-sorting.safetensors")
    monkeypatch.setattr("sys.argv", ["encoders", checkpoint, "--task", "put-block-in-bowl-seen-colors"])
    with pytest.raises(ValueError, match="m; that of put-block-in-bowl-seen-colors is x"):
        main()
