"""Training that goes wrong: each way ends in a clear sentence, with the last good state or checkpoint whole."""

import errno
import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from small import SMALL, weights

from gem_lite.cli import main
from gem_lite.cli.train import state_folder
from gem_lite.policies import checkpoints, transporter
from gem_lite.policies.checkpoints import load_policy, save_policy
from gem_lite.policies.gem import Gem
from gem_lite.training import train


def test_a_loss_that_is_not_finite_stops_with_the_state_intact(prepared, model, tmp_path, monkeypatch):
    steps, memory = prepared
    monkeypatch.setattr(train, "SAVE_EVERY", 1)
    calls = []
    honest = Gem.losses

    def spoilt(*args):
        calls.append(1)
        losses = honest(*args)
        return losses | {"pick": losses["pick"] * float("nan")} if len(calls) == 3 else losses

    monkeypatch.setattr(Gem, "losses", spoilt)
    with pytest.raises(FloatingPointError, match=r"pick loss is nan at step 2; .*state.pt holds step 2, intact"):
        train.train(Gem(SMALL, model, memory), steps, seed=0, run=tmp_path)
    assert torch.load(tmp_path / "state.pt")["step"] == 2


def test_a_gradient_that_is_not_finite_never_reaches_the_weights(prepared, model, tmp_path, monkeypatch):
    steps, memory = prepared
    honest = Gem.losses

    def steep(*args):
        losses = honest(*args)
        return losses | {"place": (losses["place"] * 0).sqrt()}  # 0, with a slope of infinity times 0

    monkeypatch.setattr(Gem, "losses", steep)
    policy = Gem(SMALL, model, memory)
    before = [parameter.clone() for parameter in policy.place.parameters()]
    with pytest.raises(FloatingPointError, match="place gradient is nan at step 0; no state had been saved yet"):
        train.train(policy, steps, seed=0, run=tmp_path)
    assert all(torch.equal(old, new) for old, new in zip(before, policy.place.parameters(), strict=True))


def fail_from_the_nth_write(monkeypatch, n, suffix):
    """From the n-th file whose name holds ``suffix`` on, the disk is full."""
    calls, honest = [], Path.write_bytes

    def write(path, content):
        if suffix in path.name:
            calls.append(path)
            if len(calls) >= n:
                honest(path, content[: len(content) // 2])
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return honest(path, content)

    monkeypatch.setattr(Path, "write_bytes", write)


def test_a_full_disk_leaves_the_last_state(prepared, trained, model, tmp_path, monkeypatch):
    steps, memory = prepared
    monkeypatch.setattr(train, "SAVE_EVERY", 1)
    with monkeypatch.context() as patch:
        fail_from_the_nth_write(patch, 3, "state")
        with pytest.raises(OSError, match=r"state of step 3 cannot be saved .*No space left.* holds step 2, intact"):
            train.train(Gem(SMALL, model, memory, seed=3), steps, seed=3, run=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["state.pt"]
    resumed = Gem(SMALL, model, memory, seed=99)
    torch.rand(1)  # What others draw from the global generator must not matter.
    train.train(resumed, steps, seed=3, run=tmp_path)
    assert torch.equal(weights(resumed), weights(trained[0]))


def test_a_full_disk_leaves_the_old_checkpoint(prepared, model, tmp_path, monkeypatch):
    old, path = Gem(SMALL, model, prepared[1], seed=1), tmp_path / "policy.safetensors"
    save_policy(old, path, {})
    for file in ("safetensors", "json"):
        with monkeypatch.context() as patch:
            fail_from_the_nth_write(patch, 1, file)
            with pytest.raises(OSError, match="No space left"):
                save_policy(Gem(SMALL, model, prepared[1], seed=2), path, {})
        assert torch.equal(weights(load_policy(path, model)), weights(old))
        assert sorted(p.name for p in tmp_path.iterdir()) == ["policy.json", "policy.safetensors"]


TEAM = """
import pickle, sys, types
from pathlib import Path
from accelerate import PartialState
from gem_lite import clip, demonstrations
from gem_lite.training import step_files, train
from gem_lite.policies import methods
from gem_lite.policies.gem import Gem

folder, demos = Path(sys.argv[1]), demonstrations.load(Path(sys.argv[2]))
rank = PartialState(cpu=True).process_index

method, settings = methods.find("transporter-lan")
policy = method(settings, clip.load())
honest = policy.embed
prepared = []
policy.embed = lambda views: prepared.append(1) or honest(views)
steps = train.prepared_steps(policy, demos, folder)
(folder / f"prepared-{rank}").write_text(f"{len(prepared)} {len(steps)} {step_files.fingerprint(steps)}")

settings, dim, steps = pickle.loads((folder / "given").read_bytes())
policy = Gem(settings, types.SimpleNamespace(dim=dim), seed=3)
train.train(policy, steps, seed=3, run=folder)
weights = {name: module.state_dict() for name, module in policy.roles.items()}
(folder / f"weights-{rank}").write_bytes(pickle.dumps(weights))
"""
"""Each of several processes prepares demonstrations, and trains on given steps."""


@pytest.fixture(scope="module")
def team(prepared, model, demo_set, tmp_path_factory):
    """The folder in which two processes have run `TEAM`."""
    folder = tmp_path_factory.mktemp("team")
    (folder / "given").write_bytes(pickle.dumps((SMALL, model.dim, prepared[0])))
    (folder / "team.py").write_text(TEAM)
    # What `accelerate launch` calls on several GPUs; on CPUs it wants MPI.
    launch = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    command = [*launch, str(folder / "team.py"), str(folder), str(demo_set[0])]
    subprocess.run(command, check=True, capture_output=True, timeout=1800)
    return folder


def test_several_processes_average_their_gradients(team, trained):
    first, second = (pickle.loads((team / f"weights-{rank}").read_bytes()) for rank in (0, 1))
    assert torch.load(team / "state.pt")["identity"]["processes"] == 2
    alone = trained[0]
    for role, module in alone.roles.items():
        assert all(torch.equal(first[role][name], second[role][name]) for name in first[role])
        assert not all(torch.allclose(first[role][name], value) for name, value in module.state_dict().items())


def test_of_several_processes_one_prepares(team, demo_set):
    first, second = ((team / f"prepared-{rank}").read_text().split() for rank in (0, 1))
    steps = sum(len(demo.steps) for demo in demo_set[1])
    assert first[:2] == [str(steps), str(steps)]
    assert second == ["0", *first[1:]]


def run_main(capsys, *arguments):
    """(exit status, what was written to stderr) of ``gem-lite train ARGUMENTS``."""
    code = main(["train", *map(str, arguments)])
    return code, capsys.readouterr().err


def test_the_command_line_ends_in_clear_sentences(demo_set, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    for folder, words, parts in (
        (demo_set[0], ("--method", "gpt"), ("method must be one of", "got 'gpt'", "transporter-lan")),
        (tmp_path / "nowhere", (), ("holds no demonstrations",)),
        (demo_set[0], ("--device", "cuda"), ("no GPU",)),
    ):
        code, said = run_main(capsys, folder, tmp_path / "policy.safetensors", *words)
        assert code == 2 and all(part in said for part in parts)
    assert not (tmp_path / "policy.safetensors").exists()


def test_a_command_that_is_stopped_goes_on_where_it_was(demo_set, tmp_path, monkeypatch, capsys):
    """It is stopped in the preparation, then the disk is full at the very end."""
    run, checkpoint = tmp_path / "run", tmp_path / "t.safetensors"
    command = [demo_set[0], checkpoint, "--method", "transporter-lan", "--state", run, "--seed", 4]
    command += ["--config.steps", 2, "--config.batch", 1]
    prepared = []
    honest = transporter.TransporterLan.embed

    def stopped_at_the_third(*args):
        prepared.append(1)
        if len(prepared) == 3:
            raise KeyboardInterrupt
        return honest(*args)

    monkeypatch.setattr(transporter.TransporterLan, "embed", stopped_at_the_third)
    code, said = run_main(capsys, *command)
    assert code == 130 and "the same command goes on" in said
    with monkeypatch.context() as patch:
        fail_from_the_nth_write(patch, 1, "t.safetensors")
        code, said = run_main(capsys, *command)
    assert code == 2 and "No space left" in said and not checkpoint.exists()
    assert torch.load(run / "state.pt")["step"] == 2
    assert main(["train", *map(str, command)]) == 0
    said = capsys.readouterr().out
    assert "resuming at step 2" in said and "transporter-lan on 2 demonstrations" in said
    card = checkpoints.read_card(checkpoint)
    assert (card["method"], card["seed"], card["demos"]) == ("transporter-lan", 4, 2)
    steps = sum(len(demo.steps) for demo in demo_set[1])
    assert len(prepared) == steps + 1, "the two steps before the stop are not prepared again"
    assert list(run.iterdir()) == []


def test_two_trainings_whose_checkpoints_have_one_name_keep_apart(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    one, other, again = map(
        state_folder, (Path("a/p.safetensors"), Path("b/p.safetensors"), tmp_path / "a" / "p.safetensors")
    )
    assert one == again != other and one.parent == other.parent == Path("runs")


def test_a_damaged_state_is_named(prepared, trained, model, tmp_path):
    state = tmp_path / "state.pt"
    for content in (b"", b"half", (trained[1] / "state.pt").read_bytes()[:-1000]):
        state.write_bytes(content)
        with pytest.raises(
            ValueError, match=r"state\.pt is cut off or no state of a training: remove it to begin anew$"
        ):
            train.train(Gem(SMALL, model, prepared[1]), prepared[0], seed=0, run=tmp_path)


def test_the_paper_configuration_starts_on_a_cpu(demo_set, tmp_path, monkeypatch, capsys):
    """30,000 steps at 320 x 160 are for a GPU; here the command is stopped after one step."""
    honest, drawn = train.make_batch, []

    def stop_at_the_second(*args):
        drawn.append(1)
        if len(drawn) == 2:
            raise KeyboardInterrupt
        return honest(*args)

    monkeypatch.setattr(train, "make_batch", stop_at_the_second)
    monkeypatch.setattr(train, "SAVE_SECONDS", 0)
    words = ("--preset", "paper", "--episodes", 1, "--state", tmp_path / "run")
    code, said = run_main(capsys, demo_set[0], tmp_path / "paper.safetensors", *words)
    assert code == 130 and "the same command goes on from the last state" in said
    state = torch.load(tmp_path / "run" / "state.pt")
    assert state["step"] == 1 and state["identity"]["config"]["steps"] == 30_000
