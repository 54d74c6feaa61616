"""Training that goes wrong: each way ends in a clear sentence, with the last good state or checkpoint whole."""

import dataclasses
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from damages import stop_at_write
from small import SMALL, weights

from gem_lite.cli import main
from gem_lite.cli.train import state_folder
from gem_lite.policies import checkpoints, transporter
from gem_lite.policies.checkpoints import load_policy, save_policy
from gem_lite.policies.gem import Gem
from gem_lite.policies.gem_config import GemConfig
from gem_lite.training import train

FULL = OSError("No space left on device")


@pytest.mark.parametrize(
    ("step", "role", "spoil", "message"),
    [
        (2, "pick", lambda loss: loss * float("nan"), r"pick loss is nan at step 2; .*state\.pt holds step 2, intact"),
        # 0, with a slope of infinity times 0
        (0, "place", lambda loss: (loss * 0).sqrt(), "place gradient is nan at step 0; no state had been saved yet"),
    ],
)
def test_what_is_not_finite_reaches_neither_weights_nor_state(
    step, role, spoil, message, prepared, model, tmp_path, monkeypatch
):
    monkeypatch.setattr(train, "SAVE_EVERY", 1)
    policy, honest, before = Gem(SMALL, model, prepared[1]), Gem.losses, []

    def spoilt(*args):
        before.append(weights(policy))
        losses = honest(*args)
        return losses | {role: spoil(losses[role])} if len(before) == step + 1 else losses

    monkeypatch.setattr(Gem, "losses", spoilt)
    with pytest.raises(FloatingPointError, match=message):
        train.train(policy, prepared[0], seed=0, run=tmp_path)
    assert torch.equal(weights(policy), before[-1])
    assert (tmp_path / "state.pt").exists() == (step > 0)
    assert step == 0 or torch.load(tmp_path / "state.pt")["step"] == step


def test_a_full_disk_leaves_the_last_state(prepared, trained, model, tmp_path, monkeypatch):
    steps, memory = prepared
    monkeypatch.setattr(train, "SAVE_EVERY", 1)
    with monkeypatch.context() as patch:
        stop_at_write(patch, 4, FULL, "state")  # after two writes, each with its rename
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
            stop_at_write(patch, 0, FULL, file)
            with pytest.raises(OSError, match="No space left"):
                save_policy(Gem(SMALL, model, prepared[1], seed=2), path, {})
        assert torch.equal(weights(load_policy(path, model)), weights(old))
        assert sorted(p.name for p in tmp_path.iterdir()) == ["policy.json", "policy.safetensors"]


NOTING = """
import pickle
from pathlib import Path
import torch
from accelerate import PartialState
from gem_lite.policies.transporter import TransporterLan
from gem_lite.training import step_files, train

embed, honest, embedded = TransporterLan.embed, train.train, []
TransporterLan.embed = lambda *args: embedded.append(1) or embed(*args)

def noting(policy, steps, seed, run, device, **others):
    cost = honest(policy, steps, seed, run, device, **others)
    state = {role: module.state_dict() for role, module in policy.roles.items()}
    noted = len(embedded), len(steps), step_files.fingerprint(steps), state
    Path(f"noted-{PartialState().process_index}").write_bytes(pickle.dumps(noted))
    if PartialState().is_main_process:
        Path("processes").write_text(str(torch.load(run / "state.pt")["identity"]["processes"]))
    return cost

train.train = noting
"""
"""A module for --import: each process notes what it prepared, read and learned."""


@pytest.mark.release
def test_several_processes_train_by_the_same_command(demo_set, model, tmp_path):
    (tmp_path / "noting.py").write_text(NOTING)
    command = ["train", str(demo_set[0]), "policy.safetensors", "--method", "transporter-lan"]
    command += ["--config.steps", "2", "--config.batch", "1", "--config.widths", "4", "4", "8", "8"]
    # What `accelerate launch -m gem_lite.cli train` calls on several GPUs; on CPUs it wants MPI.
    launch = "-m torch.distributed.run --standalone --nproc-per-node 2 -m gem_lite.cli"
    words = [sys.executable, *launch.split(), *command, "--import", "noting"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("wrote policy.safetensors") == 1
    first, second = (pickle.loads((tmp_path / f"noted-{rank}").read_bytes()) for rank in (0, 1))
    steps = sum(len(demo.steps) for demo in demo_set[1])
    assert first[:2] == (steps, steps), "one prepares"
    assert second[:3] == (0, *first[1:3]), "and both read the same"
    assert (tmp_path / "processes").read_text() == "2"
    command[2] = str(tmp_path / "alone.safetensors")
    assert main([*command, "--state", str(tmp_path / "alone")]) == 0
    together, alone = (load_policy(tmp_path / f"{name}.safetensors", model) for name in ("policy", "alone"))
    assert together.config.steps == 2
    for role, module in alone.roles.items():
        own, averaged = module.state_dict(), together.roles[role].state_dict()
        assert all(torch.equal(first[3][role][name], second[3][role][name]) for name in own)
        assert all(torch.equal(first[3][role][name], averaged[name]) for name in own)
        assert not all(torch.allclose(averaged[name], value) for name, value in own.items())


def run_main(capsys, *arguments):
    """(exit status, what was written to stderr) of ``gem-lite train ARGUMENTS``."""
    code = main(["train", *map(str, arguments)])
    return code, capsys.readouterr().err


def test_a_missing_gpu_is_said(demo_set, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    code, said = run_main(capsys, demo_set[0], "policy.safetensors", "--device", "cuda")
    assert code == 2 and "no GPU" in said and not list(tmp_path.iterdir())


def test_a_command_that_is_stopped_goes_on_where_it_was(demo_set, tmp_path, monkeypatch, capsys):
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
        stop_at_write(patch, 0, FULL, "t.safetensors")
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
    paths = Path("a/p.safetensors"), Path("b/p.safetensors"), tmp_path / "a" / "p.safetensors"
    one, other, again = map(state_folder, paths)
    assert one == again != other and one.parent == other.parent == Path("runs")


def test_a_damaged_state_is_named(prepared, trained, model, tmp_path):
    state = tmp_path / "state.pt"
    for content in (b"", b"half", (trained[1] / "state.pt").read_bytes()[:-1000]):
        state.write_bytes(content)
        with pytest.raises(ValueError, match=r"state\.pt is cut off or no state .*: remove it to begin anew$"):
            train.train(Gem(SMALL, model, prepared[1]), prepared[0], seed=0, run=tmp_path)


@pytest.mark.release
def test_the_paper_configuration_trains_on_a_cpu(demo_set, tmp_path, capsys):
    words = ("--preset", "paper", "--episodes", 1, "--config.steps", 1, "--state", tmp_path / "run")
    code, _ = run_main(capsys, demo_set[0], tmp_path / "paper.safetensors", *words)
    card = checkpoints.read_card(tmp_path / "paper.safetensors")
    assert code == 0 and GemConfig.from_dict(card["config"]) == dataclasses.replace(GemConfig.preset("paper"), steps=1)
