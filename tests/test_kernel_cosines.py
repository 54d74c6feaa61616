import kernel_cosines
import numpy as np
import pytest
import torch

from experiments.clip_tabletop import vocabulary
from gem_lite import clip, language
from gem_lite.policies import checkpoints


def test_the_pairs_are_balanced_and_say_why():
    pairs = kernel_cosines.read_pairs()
    assert len(pairs) == len({(pair.phrase, pair.other) for pair in pairs}) == 30
    assert sum(pair.same_grasp for pair in pairs) == 15
    known = {word for names in (*vocabulary.NOUNS.values(), *vocabulary.COLORS.values()) for word in names}
    words = set(" ".join(known).split()) | {"piles", "blocks", "of", "pile"}
    for pair in pairs:
        assert pair.why and pair.phrase != pair.other
        assert set(f"{pair.phrase} {pair.other}".split()) <= words
        assert language.PARSERS.find("grammar")(f"put the {pair.phrase} in the brown box").pick == pair.phrase.lower()


def test_a_wrong_entry_is_named(tmp_path):
    file = tmp_path / "pairs.csv"
    file.write_text("phrase,other,same_grasp,why\na,b,yes,c\n")
    with pytest.raises(ValueError, match="same_grasp must be 0 or 1, got 'yes'"):
        kernel_cosines.read_pairs(file)


def test_centred_cosines_ignore_what_all_kernels_share():
    torch.manual_seed(0)
    shared, own = 10 * torch.randn(3, 5, 5), torch.randn(3, 5, 5)
    made = torch.stack([shared + own, shared + own, shared - own, shared - own])
    cosines = kernel_cosines.centred_cosines(made)
    expected = torch.tensor([[1.0, 1, -1, -1], [1, 1, -1, -1], [-1, -1, 1, 1], [-1, -1, 1, 1]])
    assert torch.allclose(cosines, expected, atol=1e-4)


def test_a_policys_kernels_differ_for_different_things():
    policy = checkpoints.load_policy(clip.DATA / "gem-packing-shapes.safetensors", clip.load())
    pairs = [("red star", "red star"), ("red star", "red ring"), ("red star", "red mug")]
    same, other, _ = kernel_cosines.pair_cosines(policy, [kernel_cosines.PhrasePair(*pair, True, "") for pair in pairs])
    assert same == pytest.approx(1, abs=1e-5)
    assert other < 0.99
    assert np.isfinite(other)
