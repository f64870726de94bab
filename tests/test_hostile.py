"""Hard to break: files, calls, environments and bodies that nobody would wish for.

Bad command lines are in test_scripts.py, broken goals in test_evaluate.py, bad planners there, too.
"""

import io
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import textwrap
import warnings
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

robot_model = import_module("01_robot_model")
env = import_module("03_env")
evaluate = import_module("05_evaluate")
torch = evaluate.ppo.torch
ROOT = Path(__file__).resolve().parents[1]
SHIPPED = {"pt": "policy.pt", "json": "baseline_tuned.json", "npz": "search.npz"}

# ------------------------------------------------------------------------ files
class Code:
    """A pickle that would leave a trace when it is read carelessly."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)

def loop(path):
    other = path.with_name("other")
    other.symlink_to(path)
    path.symlink_to(other)

def unreadable(path):
    path.write_bytes(b"secret")
    path.chmod(0)
    if os.access(path, os.R_OK):
        pytest.skip("nothing is unreadable for this user")

def huge(path):
    with open(path, "wb") as file:
        file.truncate(20 * 2**30)  # takes no room on the disk

DAMAGE = {  # how a file of ours came to be what it is now
    "missing": lambda path, good: None,
    "empty": lambda path, good: path.write_bytes(b""),
    "half": lambda path, good: path.write_bytes(good[: len(good) // 2]),
    "but for its end": lambda path, good: path.write_bytes(good[:-3]),
    "random": lambda path, good: path.write_bytes(np.random.default_rng(0).bytes(5000)),
    "text": lambda path, good: path.write_text("hello\n"),
    "a list": lambda path, good: path.write_text("[1, 2]"),
    "a deep list": lambda path, good: path.write_text("[" * 100_000),
    "a pickle": lambda path, good: path.write_bytes(pickle.dumps({"format": 1})),
    "code": lambda path, good: path.write_bytes(pickle.dumps(Code(path.with_name("touched")))),
    "a folder": lambda path, good: path.mkdir(),
    "a loop of links": lambda path, good: loop(path),
    "unreadable": lambda path, good: unreadable(path),
}

@pytest.mark.parametrize("end", SHIPPED)
@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_file_is_refused_in_one_line(tmp_path, recwarn, end, damage):
    good = (ROOT / "results" / "pymunk" / SHIPPED[end]).read_bytes()
    path = tmp_path / f"file.{end}"
    try:
        DAMAGE[damage](path, good)
    except OSError as error:
        pytest.skip(f"this system has no such thing: {error}")
    with pytest.raises(evaluate.InputError) as caught:
        evaluate.load(path, "pymunk")
    message = str(caught.value)
    assert "\n" not in message and str(path) in message and len(message) < 300, message
    assert not (tmp_path / "touched").exists(), "it ran what was in the file"
    told = [str(one.message) for one in recwarn if one.category is not ResourceWarning]
    assert not told, "warnings take lines of their own (but those about resources are not shown)"

@pytest.mark.skipif(sys.platform == "win32", reason="such a file would take its room there")
@pytest.mark.parametrize("end", ["pt", "npz"])
def test_a_huge_file_is_refused_at_once(tmp_path, end):
    path = tmp_path / f"file.{end}"
    huge(path)
    with pytest.raises(evaluate.InputError):
        evaluate.load(path, "pymunk")

@pytest.mark.parametrize("end", SHIPPED)
def test_a_file_for_the_other_simulator_is_told_so(end):
    with pytest.raises(evaluate.StaleError, match="made for another robot.*simulator is pymunk"):
        evaluate.load(ROOT / "results" / "pymunk" / SHIPPED[end], "mujoco")

@pytest.mark.parametrize("spoil", [
    lambda stored: stored.update(act_dim=5), lambda stored: stored.update(obs_dim=22),
    lambda stored: stored.update(hidden=[200_000, 200_000]),  # 160 GB, if somebody made it
    lambda stored: stored.pop("fits"), lambda stored: stored.update(fits=7),
    lambda stored: stored.update(minutes=float("nan")),
    lambda stored: stored.update(minutes=torch.ones(2)), lambda stored: stored.pop("config"),
    *[lambda stored, k=k: stored["config"].update(sharpest=k) for k in (float("nan"), "sharp", [])],
    lambda stored: stored["state_dict"].update({"actor.4.bias": torch.full((12,), float("nan"))})])
def test_a_policy_that_cannot_walk_is_refused_before_anybody_walks(spoil, tmp_path):
    stored = torch.load(ROOT / "results" / "pymunk" / "policy.pt", weights_only=True)
    spoil(stored)
    if stored["act_dim"] == 5 or stored["obs_dim"] == 22:  # and its weights are of that shape
        model = evaluate.ppo.ActorCritic(stored["obs_dim"], stored["act_dim"], stored["hidden"])
        stored["state_dict"] = model.state_dict()
    torch.save(stored, tmp_path / "policy.pt")
    with pytest.raises(evaluate.InputError) as caught:
        evaluate.load(tmp_path / "policy.pt", "pymunk")
    assert len(str(caught.value).splitlines()) == 1

# ------------------------------------------------------------------------ calls
WRONG_ACTIONS = (np.full(6, np.nan), np.full(6, np.inf), np.zeros(5), np.zeros((2, 6)), "left",
                 None, np.array([None] * 6), np.zeros(6, complex), [[0.5] * 6, [0.5]],
                 {"left": 0.5})

@pytest.fixture(scope="module", params=["pymunk", "mujoco"])
def walker(request):
    one = env.FootstepEnv(request.param)
    yield one
    one.close()

@pytest.mark.parametrize("action", WRONG_ACTIONS, ids=lambda action: repr(action)[:25])
def test_a_wrong_action_changes_nothing(walker, action):
    walker.reset(seed=0)
    before = walker.world.pose.copy(), walker.world.steps.copy()
    with pytest.raises(ValueError, match=r"action must be finite numbers of shape \(6,\)"):
        walker.step(action)
    np.testing.assert_array_equal(walker.world.pose, before[0])
    np.testing.assert_array_equal(walker.world.steps, before[1])
    walker.step(np.full(6, 0.5))  # and it goes on

@pytest.mark.parametrize("action", [[0.5] * 6, np.full(6, 1e300), np.full(6, -1), np.zeros(6, int),
                                    np.zeros(6, bool), np.zeros(6, np.float16)], ids=repr)
def test_an_action_of_any_real_type_is_clipped(walker, action):
    walker.reset(seed=0)
    seen, reward, *_ = walker.step(action)
    assert walker.observation_space.contains(seen) and np.isfinite(reward)

@pytest.mark.parametrize("call", [
    lambda one: one.reset(options={"goal": (np.nan, 0, 0)}),
    lambda one: one.reset(options={"goal": (1, 2)}),
    lambda one: one.reset(options={"goal": "home"}),
    lambda one: one.reset(seed=-1), lambda one: one.reset(seed=1.5)])
def test_a_wrong_reset_is_an_error(walker, call):
    with pytest.raises((ValueError, TypeError)) as caught:
        call(walker)
    assert len(str(caught.value).splitlines()) == 1

@pytest.mark.parametrize("sim", ["pymunk", "mujoco"])
def test_a_step_before_the_first_reset_is_a_step(sim):
    one = env.FootstepEnv(sim, noise=True)
    seen, reward, *_ = one.step(one.world.neutral_action)
    one.close()
    assert one.observation_space.contains(seen) and np.isfinite(reward)

def test_a_goal_may_be_as_far_as_numbers_go(walker):
    walker.reset(seed=0, options={"goal": (1e308, -1.5e308, 1e308)})
    seen, reward, *_ = walker.step(walker.world.neutral_action)
    assert walker.observation_space.contains(seen) and np.isfinite(reward)

def test_a_step_after_the_end_walks_on_until_a_reset(walker):
    walker.reset(seed=0, options={"goal": (0, 0, 0)})
    for _ in range(4):  # the second one ends it
        seen, reward, *_ = walker.step(walker.world.neutral_action)
    assert walker.observation_space.contains(seen) and np.isfinite(reward)

@pytest.mark.parametrize("sim", ["pymunk", "mujoco"])
@pytest.mark.parametrize("cores", [1, 2])
def test_a_closed_environment_may_be_closed_again(sim, cores):
    envs = env.FootstepVectorEnv(2, sim, cores=cores)
    envs.reset(seed=0)
    envs.close()
    envs.close()
    if sim == "pymunk" and cores > 1:  # its processes are gone; the others need none
        for call in (envs.reset, lambda: envs.step(np.full((2, 6), 0.5))):
            with pytest.raises(OSError, match="closed"):
                call()

@pytest.mark.skipif(sys.platform == "win32", reason="no process can be sent Ctrl-C alone there")
def test_ctrl_c_does_not_end_the_processes_of_the_simulator():
    """The terminal sends it to them, too; what ends them is the stage, by closing their pipes."""
    robot = robot_model.RobotModel()
    sim = robot_model.make_sim("pymunk", 2, robot_model.stance(robot, planar=True), cores=2)
    sim.reset([0, 1])  # they have answered, so they run
    for process in sim.processes:
        os.kill(process.pid, signal.SIGINT)
    sim.reset([0, 1])
    sim.close()

@pytest.mark.parametrize("make", [
    lambda: env.FootstepVectorEnv(-1), lambda: env.FootstepVectorEnv(1.5),
    lambda: env.FootstepVectorEnv(2, "webots"), lambda: env.FootstepVectorEnv(2, None),
    lambda: env.FootstepVectorEnv(2, ["pymunk"])])
def test_an_impossible_environment_is_an_error(make):
    with pytest.raises((ValueError, TypeError)) as caught:
        make()
    assert len(str(caught.value).splitlines()) == 1

# ------------------------------------------------------------------------ surroundings
@pytest.mark.slow
def test_a_bare_surrounding_is_enough(tmp_path):
    """No HOME, a backend without its display, an ASCII console, a read-only folder."""
    folder = tmp_path / "read only"
    folder.mkdir()
    folder.chmod(0o555)
    kept = {name: os.environ[name] for name in ("PATH", "SYSTEMROOT", "LD_LIBRARY_PATH")
            if name in os.environ}
    done = subprocess.run(
        [sys.executable, ROOT / "03_env.py", "--out", tmp_path / "out"], capture_output=True,
        encoding="ascii", errors="replace", cwd=folder, check=False,
        env=kept | {"MPLBACKEND": "TkAgg", "PYTHONIOENCODING": "ascii", "LC_ALL": "C"})
    assert done.returncode == 0, done.stderr[-2000:]
    assert (tmp_path / "out" / "03_rewards.png").is_file() and not list(folder.iterdir())

def started(folder, *arguments, **environment):
    """A stage in a process of its own: what it says and its exit code."""
    return subprocess.run([sys.executable, *map(str, arguments)], cwd=folder, check=False,
                          capture_output=True, encoding="utf-8", errors="replace", timeout=120,
                          env=os.environ | environment)

def test_no_setting_of_a_display_or_a_renderer_matters(tmp_path):
    script = ("import importlib; robot_model = importlib.import_module('01_robot_model')\n"
              "args = robot_model.StageParser('').parse(['--mujoco'])\n"
              "robot = robot_model.RobotModel()\n"
              "robot_model.make_sim(args.sim, 1, robot_model.stance(robot)).close()\n"
              "robot_model.plt.figure().savefig('empty.png')")
    done = started(tmp_path, "-c", script, PYTHONPATH=str(ROOT), MPLBACKEND="nonsense",
                   MUJOCO_GL="nonsense")
    assert (done.returncode, done.stderr) == (0, "") and (tmp_path / "empty.png").is_file()

def test_a_console_without_an_encoding_is_enough(monkeypatch, tmp_path, capsys):
    """As in a notebook."""
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stopped:
        evaluate.main(["--policy", "none.pt"])
    assert stopped.value.code == 2 and "no such file" in capsys.readouterr().err

@pytest.mark.parametrize("error, code, said", [
    (OSError("the disk is full"), 2, "the disk is full"), (KeyboardInterrupt(), 130, "interrupted"),
    (BrokenPipeError(32, "Broken pipe"), 2, "Broken pipe")], ids=repr)
def test_what_a_stage_cannot_help_is_one_line(error, code, said, tmp_path):
    script = (f"import importlib; robot_model = importlib.import_module('01_robot_model')\n"
              f"def main():\n    print('begun')\n    raise {error!r}\nrobot_model.run(main)")
    done = started(tmp_path, "-c", script, PYTHONPATH=str(ROOT))
    assert done.returncode == code and said in done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr

def test_processes_of_the_simulator_do_not_load_the_script_that_started_them(tmp_path):
    script = tmp_path / "mine.py"
    script.write_text(textwrap.dedent("""
        import importlib, sys
        env = importlib.import_module("03_env")
        assert __name__ == "__main__", "a process has loaded this again"
        envs = env.FootstepVectorEnv(2, cores=2)
        print(envs.reset(seed=0)[0].shape, __file__)
        envs.close()"""), encoding="utf-8")
    done = started(tmp_path, script, PYTHONPATH=str(ROOT))
    assert done.returncode == 0 and done.stdout.split() == ["(2,", "20)", str(script)], done.stderr

# ------------------------------------------------------------------------ bodies
EXTREME = {
    "no friction": {"friction": 0.0}, "friction 2": {"friction": 2.0},
    "no motors": {"torque_limit": (0.1,) * 6},
    "stiff": {"stiffness": 6000.0, "planar_gain": 800.0},
    "no gravity": {"gravity": 0.0}, "coarse time": {"control_dt": 0.04},
}

def walk_wildly(sim, changes, steps, count=16):
    """Whatever happens, nothing is raised, warned of or not finite."""
    robot = replace(robot_model.RobotModel(), **changes)
    envs = env.FootstepVectorEnv(count, sim, noise=True, imu=True, robot=robot, cores=1)
    dice, falls = np.random.default_rng(0), 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        envs.reset(seed=0)
        for _ in range(steps // count):
            seen, reward, terminated, _, _ = envs.step(dice.random((count, 6)))
            assert np.isfinite(reward).all() and np.isfinite(seen).all()
            assert np.isfinite(envs.world.pose).all() and np.isfinite(envs.world.tilt).all()
            assert envs.observation_space.contains(seen)
            falls += terminated.sum()
    envs.close()
    return falls

@pytest.mark.parametrize("sim", ["pymunk", "mujoco"])
@pytest.mark.parametrize("extreme", EXTREME)
def test_an_extreme_body_falls_and_nothing_else_happens(sim, extreme, capfd):
    walk_wildly(sim, EXTREME[extreme], 160)
    assert capfd.readouterr() == ("", ""), "a simulator wrote to the terminal"

@pytest.mark.slow
@pytest.mark.parametrize("sim", ["pymunk", "mujoco"])
def test_many_double_steps_of_extreme_bodies(sim, capfd, tmp_path, monkeypatch):
    """More with DOUBLE_STEPS=100000 python -m pytest -m slow -k many_double_steps."""
    monkeypatch.chdir(tmp_path)
    for changes in EXTREME.values():
        walk_wildly(sim, changes, int(os.environ.get("DOUBLE_STEPS", "6000")) // len(EXTREME), 64)
    assert capfd.readouterr() == ("", "") and not list(tmp_path.iterdir())

# ------------------------------------------------------------------------ killed
KILLED = """
    import os, random, signal, sys
    from importlib import import_module
    ppo, env = import_module("04_ppo"), import_module("03_env")

    def train(out, resume=False):
        cfg = ppo.PPOConfig(num_envs=4, rollout=8, epochs=2, minibatch=16, checkpoint_every=2,
                            unsettled=0)
        ppo.train(cfg, lambda n: env.FootstepVectorEnv(n, "pymunk", True, cores=1), out, 90 * 32,
                  seed=5, resume=resume, progress=False)

    def dying(function, when, write=False):
        calls = []

        def call(*args, **kw):
            calls.append(1)
            if len(calls) < when:
                return function(*args, **kw)
            if write:  # in the middle of a file
                path, content = args
                temporary = path.with_name(f"{path.stem}.{os.getpid()}.tmp{path.suffix}")
                content(temporary)
                whole = temporary.read_bytes()
                temporary.write_bytes(whole[: len(whole) // 2])
            os.kill(os.getpid(), signal.SIGKILL)
        return call

    if __name__ == "__main__":
        out, number = sys.argv[1], int(sys.argv[2])
        if number >= 0:
            phase, when = (("collect", 3), ("improve", 3), ("atomic_write", 2), ("collect", 1),
                           ("atomic_write", 1))[number % 5]
            when += random.Random(number).randrange(3)
            owner = ppo.robot_model if phase == "atomic_write" else ppo
            setattr(owner, phase, dying(getattr(owner, phase), when, owner is not ppo))
        train(out, resume=os.path.exists(os.path.join(out, "checkpoint.pt")))
"""

@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no kill -9 here")
def test_twenty_kills_change_no_weight(tmp_path):
    """kill -9 while collecting, improving and writing; then the weights of the quiet training."""
    script = tmp_path / "train.py"
    script.write_text(textwrap.dedent(KILLED), encoding="utf-8")

    def run(folder, number):
        return subprocess.run([sys.executable, script, tmp_path / folder, str(number)], check=False,
                              env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True)

    assert run("quiet", -1).returncode == 0
    for number in range(20):
        done = run("killed", number)
        assert done.returncode == -signal.SIGKILL, done.stderr.decode()[-2000:]
        for file in {*(tmp_path / "killed").glob("*.pt")} - {*tmp_path.rglob("*.tmp.pt")}:
            torch.load(file, weights_only=True)  # whole: the old one or the new one
    last = run("killed", -1)
    assert last.returncode == 0, last.stderr.decode()[-2000:]
    quiet, killed = (torch.load(tmp_path / name / "policy.pt", weights_only=True)["state_dict"]
                     for name in ("quiet", "killed"))
    assert all(torch.equal(quiet[name], killed[name]) for name in quiet), "not bit for bit"

@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux' disk that is always full")
@pytest.mark.parametrize("error", ["the system's", "PyTorch's"])
def test_a_full_disk_is_one_line_and_damages_nothing(error, tmp_path, monkeypatch, capfd):
    """The temporary file of every atomic write lies on the full disk."""
    ppo = evaluate.ppo
    shutil.copy(ROOT / "results" / "pymunk" / "policy.pt", tmp_path / "policy.pt")
    before = (tmp_path / "policy.pt").read_bytes()
    write = ppo.robot_model.atomic_write

    def to_the_full_disk(path, content):
        temporary = path.with_name(f"{path.stem}.{os.getpid()}.tmp{path.suffix}")
        if not temporary.is_symlink():
            temporary.symlink_to("/dev/full")
        write(path, content)

    def of_pytorch(stored, file):  # it raises an error of its own, and leaves a part of the file
        file.write_bytes(b"a part")
        raise RuntimeError("[enforce fail at inline_container.cc] . unexpected pos 1 vs 2")

    if error == "PyTorch's":
        monkeypatch.setattr(torch, "save", of_pytorch)
    else:
        monkeypatch.setattr(ppo.robot_model, "atomic_write", to_the_full_disk)
    with pytest.raises(SystemExit) as stopped:
        ppo.main(["--env", "Pendulum-v1", "--steps", "2048", "--out", str(tmp_path)])
    lines = [line for line in capfd.readouterr().err.splitlines() if "steps/s" not in line]
    assert stopped.value.code == 2 and len([line for line in lines if line.strip()]) == 1, lines
    assert (tmp_path / "policy.pt").read_bytes() == before, "the good one is still there"
    assert not list(tmp_path.glob("*.tmp*")), "what could not be finished takes no place"

def test_every_figure_is_written_atomically():
    for path in [*ROOT.glob("0*.py"), *(ROOT / "tests" / "studies").glob("*.py")]:
        for line in path.read_text(encoding="utf-8").splitlines():
            if "savefig(" in line or ".save(" in line and "torch" not in line:
                assert "lambda file: " in line, f"{path.name}: not by atomic_write: {line.strip()}"

def test_nobody_needs_a_terminal_to_write_errors_to(monkeypatch):
    """`python 04_ppo.py 2>&-`, or pythonw: there is no sys.stderr, and no progress bar."""
    monkeypatch.setattr(sys, "stderr", None)
    walked = []
    robot_model.run(lambda: walked.extend(evaluate.tqdm(range(3))))
    assert walked == [0, 1, 2]

def test_two_trainings_may_write_into_one_folder(tmp_path):
    """Each has temporary files of its own: whoever is last wins, and the file is whole."""
    script = ("import sys; from importlib import import_module; from pathlib import Path\n"
              "robot_model, letter = import_module('01_robot_model'), sys.argv[1].encode()\n"
              "def write(temporary): temporary.write_bytes(letter * 10**6)\n"
              "for _ in range(50): robot_model.atomic_write(Path(sys.argv[2]), write)")
    both = [subprocess.Popen([sys.executable, "-c", script, letter, tmp_path / "file"],
                             env=os.environ | {"PYTHONPATH": str(ROOT)}) for letter in "ab"]
    assert [one.wait() for one in both] == [0, 0]
    content = (tmp_path / "file").read_bytes()
    assert content in (b"a" * 10**6, b"b" * 10**6), "half of one, half of the other"

def test_results_are_json_without_nan():
    """What others read: no NaN, no Infinity, in any of our JSON files."""
    for path in (ROOT / "results").rglob("*.json"):
        json.loads(path.read_text(encoding="utf-8"), parse_constant=lambda word: pytest.fail(word))
