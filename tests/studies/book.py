"""Writes what results/ says in words: results/<sim>/README.md and results/STUDIES.md.

    python tests/studies/book.py

From the JSON, Markdown and figures that stage 5 and the studies have shipped; so no number is
copied by hand. It also puts the tables of README and of the contest (projects.md) in their places,
each between two comments.
"""

import ast
import json
import re
import sys
import textwrap

import common
import kept
from baseline import FLOOR

sys.path.append(str(common.ROOT / "tests" / "exercises"))
import judge  # noqa: E402  (in tests/exercises)

SIMS = {"mujoco": "3-D (MuJoCo)", "pymunk": "sagittal plane and yaw (pymunk)"}
FLAG = {"mujoco": " --mujoco", "pymunk": ""}
ORDER = ("baseline", "search", "seeds", "pooled", "imu", "kicks", "decision", "falls", "times",
         "robustness", "noise", "limits", "ground", "second_walk", "ablations", "budget", "tasks",
         "stable_baselines", "rllib", "benchmark", "decision_time")
FIRST = ("limits", "baseline", "search", "seeds", "imu")  # what all others judge
# They make no sense, or would say nothing new.
ONE_SIDED = {("tasks", "mujoco"), *((name, "pymunk") for name in (
    "imu", "kicks", "decision", "falls", "robustness", "noise", "ground", "second_walk"))}
SHOWN = ("policy", "policy_imu", "baseline_tuned", "search", "baseline")

def doc(name):
    """The docstring of a study: its question, and what follows."""
    source = (common.ROOT / "tests" / "studies" / f"{name}.py").read_text(encoding="utf-8")
    question, _, rest = ast.get_docstring(ast.parse(source)).partition("\n")
    return question, rest

def explained(rest):
    """The docstring below its first line and its command."""
    text = re.sub(r"^ {4}python .*\n", "", rest, flags=re.MULTILINE)
    return text.strip()

def evaluation(sim):
    """evaluation.json of what is shipped."""
    return common.read_json(common.RESULTS / sim / "evaluation.json")

def simulator_page(sim):
    """results/<sim>/README.md: the whole table, and where the policy comes from."""
    folder, facts = common.RESULTS / sim, evaluation(sim)
    seed = f" --seed {facts['seed']}" if facts["seed"] else ""
    flags = " --noise" + " --far" * any(row["goal_std_m"] == 1.0 for row in facts["rows"])
    lines = [f"# What was measured: {SIMS[sim]}", "",
             f"`python 05_evaluate.py{FLAG[sim]}{flags}{seed}`:", "",
             (folder / "table.md").read_text(encoding="utf-8"), "## The planners", ""]
    for name, about in facts["planners"].items():
        said = ", ".join(f"{key} {value:.1f}" if isinstance(value, float) else f"{key} {value}"
                         for key, value in about.items())
        lines.append(f"- `{name}`: {said}")
    pictures = {"footsteps.png": "Footsteps", "learning_curve.png": "Learning curve",
                "animation.gif": "A race"}
    for file, title in pictures.items():
        if (folder / file).is_file():
            lines += ["", f"![{title}]({file})"]
    return "\n".join(lines) + "\n"

def studies_page():
    """results/STUDIES.md: every study that has been shipped."""
    lines = ["# What we measured, and how to measure it again", "",
             "Every table below is written by the command above it. A study writes to",
             "`runs/studies/`, and replaces what is shipped here only with `--ship`."]
    for name in ORDER:
        parts = []
        for sim, words in SIMS.items():
            file = common.RESULTS / sim / "studies" / f"{name}.md"
            if file.is_file():
                parts += ["", f"`python tests/studies/{name}.py{FLAG[sim]}`, {words}:", "",
                          file.read_text(encoding="utf-8").strip()]
                if file.with_suffix(".png").is_file():
                    parts += ["", f"![{name}, {words}]({sim}/studies/{name}.png)"]
        if parts:
            question, rest = doc(name)
            lines += ["", f"## {question}", "", explained(rest), *parts]
    return "\n".join(lines) + "\n" + missing() + again()

def again():
    """The very end: what to run after changing the robot, the walk or the task."""
    def row(name):
        source = (common.ROOT / "tests" / "studies" / f"{name}.py").read_text(encoding="utf-8")
        takes = next(ast.literal_eval(node.value) for node in ast.parse(source).body
                     if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "DURATION")
        return [f"`tests/studies/{name}.py --ship`", takes["pymunk"], takes["mujoco"]]

    lines = [["`02_walk_engine.py --tune`, paste the result into `TUNED`, and again until it stays",
              "not measured", "11 minutes a search"],
             *(row(name) for name in FIRST),
             ["`05_evaluate.py --noise --far --gif --out results/SIMULATOR`, in 3-D with a fresh "
              "`--seed`", "2 minutes", "7 minutes"],
             *(row(name) for name in ORDER if name not in FIRST),
             ["`tests/studies/book.py`", "a second: it writes all pages", "the same"]]
    return ("\n## What to run after a change of the robot, the walk or the task\n\n"
            "In this order, in 3-D each with `--mujoco`; without what comes before stage 5, nothing"
            "\nafter it fits.\n\n"
            + common.markdown(["run", "plane", "3-D"], lines))

def missing():
    """The end of that page: promises that are not kept, the next levers, what nobody has run."""
    rules, kicks = (common.read_json(common.RESULTS / "mujoco" / "studies" / f"{name}.json")
                    for name in ("decision", "kicks"))
    fall = far_falls()
    *_, hardest, felt = kicks["rows"]
    soon, *_ = falls = list(felt["falls_after"].values())

    def far(rule, purpose, key):
        rows = [row[key] for row in rules["rows"] if row["rule"].startswith(rule)
                and (row["purpose"], row["goal_std_m"]) == (purpose, 1)]
        return sum(rows) / len(rows)

    slower = far("mean", "tuning", "time_mean") / far("mode", "tuning", "time_mean") - 1
    rare, often, fresh, other = (percent(far(rule, purpose, "fall"))
                                 for purpose in ("tuning", "evaluation")
                                 for rule in ("mean", "mode"))
    open_ones = ", ".join(
        f"`{name}{FLAG[sim]}`" for name in ORDER for sim in SIMS
        if (name, sim) not in ONE_SIDED
        and not (common.RESULTS / sim / "studies" / f"{name}.md").is_file())
    wrap = textwrap.TextWrapper(100, break_on_hyphens=False)
    parts = (
        f"""In 3-D, two recipes were trained from end to end; a fall costs 6 in the first and 10 in
        the second, all else is alike. The second was kept. Then the decision was
        changed: on tuning goals the mean of the distribution falls in {rare} of the far walks, the
        mode, which the paper takes, in {often}; the mean needs {percent(slower)} more time. On
        goals where nothing was chosen it is {fresh} and {other}: what looks best where one chose
        looks less good elsewhere. Over its three trainings the recipe does not keep these promises:
        {broken("mujoco")}. On the plane it does not keep: {broken("pymunk")}.""",
        *gaps(),
        f"""What to try next. (1) The joints: of the far walks {fall["as trained"]} end in a fall,
        {fall["no static friction in the joints"]} without static friction in the joints,
        {fall["nothing but static friction"]} with nothing drawn but that, and
        {fall["2/3 of the motors' stiffness"]} with softer motors; so damp the motors, or tune the
        walk on joints without friction. (2) Feeling: an IMU takes falls and time away. (3)
        Grip: most falls happen where the ground holds best. (4) Kicks: at {hardest["speed"]} m/s
        policies of {kicks["steps"]:,} double steps fall in {percent(hardest["fall"])} of the walks,
        with an IMU in {percent(felt["fall"])}; we wanted half. Of its {sum(falls)} falls {soon} end
        in the double step of the kick, before anything could be felt. The others could perhaps be
        caught after a longer training, or by changing a double step while it is made.""",
        f"""Written, but not run in today's world: {open_ones}.""")
    text = "\n\n".join(wrap.fill(" ".join(part.split())) for part in parts)
    return f"\n## What is missing, and what to try next\n\n{text}\n"

def gaps():
    """What else we wanted of 3-D, and how much of the result is the walk."""
    studies = common.RESULTS / "mujoco" / "studies"
    names = "baseline", "search", "seeds", "limits", "second_walk"
    carrots, search, seeds, limits, second = (common.read_json(studies / f"{name}.json")
                                              for name in names)
    near, near_imu, far, far_imu = (row["falls"] for row in imu_rows())
    curves = [(studies.parent / "seeds" / str(seed) / "learning_curve.csv").read_text(
        encoding="utf-8").splitlines()[-1].split(",") for seed in kept.SEEDS]
    minutes = ", ".join(f"{float(curve[1]):.0f}" for curve in curves)
    walk_engine = kept.env.walk_engine
    widest = walk_engine.LIMITS["mujoco"]
    period = walk_engine.WalkEngine(1, walk_engine.TUNED["mujoco"]).period  # [s]
    turning = (widest.high[2] - widest.low[2]) / period  # [rad/s]

    def mean(key, std=None):
        found = [row[key] for row in seeds["rows"] if row["noise"] and row["planner"] == "policy"
                 and std in (None, row["goal_std_m"])]
        return sum(found) / len(found)

    rivals = [row["time"] for row in carrots["finalists"] + search["finalists"]
              if row["fall"] <= mean("fall")]
    slow = next(row["time_mean"] for row in second["policy"] if row["goal_std_m"] == 1)
    yield f"""We also wanted an IMU to halve the falls: {near_imu} near and {far_imu} far instead of
        {near} and {far}. To learn in 35 minutes: our three trainings took {minutes}, one of them
        beside other work ({float(curves[0][0]):,.0f} double steps, as updates are whole). Actions
        that turn at 1.3 rad/s: they can ask for {turning:.2f}; −0.36 rad inward would do.
        Feet that clear 7 mm over random plans, too: there the median is
        {1000 * limits["clearance"][0]:.1f} mm. What is kept, as far as other goals of the same kind
        can say: of the finalists of carrot and search that fall as rarely as the policies
        ({percent(mean("fall"))}, near and far together), the fastest needs {min(rivals):.2f} s,
        the policies {mean("time_mean"):.2f} s."""
    yield f"""How much of all this is the walk? The second walk above was tuned as ours, but with
        other seeds, and a policy on it needs {percent(slow / mean("time_mean", 1) - 1)} more time
        to far goals: more than our three trainings differ. Whoever tunes a better walk may win more
        than by learning longer."""
    plane, cost = (common.RESULTS / "pymunk" / "studies" / f"{name}.json"
                   for name in ("benchmark", "budget"))
    *_, crowd, most = common.read_json(plane)["rows"]
    costs = [common.read_json(path)["learning_ms"] for path in (cost, studies / "budget.json")]
    yield f"""Speed: learning takes {costs[0]:.3f} ms per double step on the plane, in 3-D
        {costs[1]:.3f}; we wanted 0.07. A planar robot takes {crowd["kB"]:.0f} kB of memory among
        {crowd["robots"]}, {most["kB"]:.0f} among {most["robots"]}, nearly all of it inside pymunk;
        we wanted 400. On one core they make {crowd["one_core"]:.0f} and {most["one_core"]:.0f}
        double steps per second; we wanted more and more."""

def broken(sim):
    """The promises that three trainings do not keep, in words."""
    promises = common.read_json(common.RESULTS / sim / "studies" / "seeds.json")["promises"]
    return "; ".join(f"{p['what']} {p['sign']} {p['limit']:.{p['digits']}f}, found "
                     f"{p['found']:.{p['digits']}f}" for p in promises if not p["kept"])

def readme_table():
    """The table of README: 3-D, with noise, without IMU; far only those who race."""
    rows = [row for row in evaluation("mujoco")["rows"] if row["noise"] and (
        row["goal_std_m"] < 1 or row["planner"] not in ("search", "baseline"))
        and row["planner"] != "policy_imu"]  # it is in the page of the simulator
    rows.sort(key=lambda row: (row["goal_std_m"], SHOWN.index(row["planner"])))
    cells = [[f"{'near' if row['goal_std_m'] < 1 else 'far'}, σ {row['goal_std_m']} m",
              f"`{row['planner']}`",
              common.with_interval(row, "success"), round(row["fall"] * row["episodes"]),
              common.number(row["time_mean"], 1), common.number(row["still_there"], 2)]
             for row in rows]
    head = ["goals", "planner", "arrived and stayed [95 % interval]", "falls", "time [s]",
            "still there"]
    return common.markdown(head, cells)

def percent(share):
    """0.031 as 3.1 %."""
    return f"{100 * share:.1f} %"

def findings():
    """What README says we found; every number comes from the files of the studies."""
    tuned, search, seeds, pooled = (
        common.read_json(common.RESULTS / "mujoco" / "studies" / f"{name}.json")
        for name in ("baseline", "search", "seeds", "pooled"))

    def mean(key, planner, std):
        """With noise; of the policy the mean over its trainings."""
        found = [row[key] for row in seeds["rows"] if row["noise"]
                 and (row["planner"], row["goal_std_m"]) == (planner, std)]
        return sum(found) / len(found)

    slow, hard = (sum(falls) / len(falls) for falls in (
        [row["fall"] for row in seeds["ground"] if (row["friction"], row["goal_std_m"]) == (mu, 1)]
        for mu in (0.4, 1.0)))
    hunts = next(row for row in evaluation("mujoco")["rows"]
                 if (row["planner"], row["noise"], row["goal_std_m"]) == ("search", True, 0.5))
    careful, bold = (next(row for row in rows if (row["factor"], row["change"]) == wanted)
                     for rows, wanted in (
                         (search["finalists"], tuple(evaluation("mujoco")["planners"]["search"][key]
                                                     for key in ("factor", "change"))),
                         (search["tried"], (1.0, 1.0))))
    carrot = next(one["time_ratio"] for one in evaluation("mujoco")["ratios"] if (
        one["planner"], one["reference"], one["noise"], one["goal_std_m"]) == (
        "baseline_tuned", "baseline", True, 0.5))
    joints = far_falls()
    often = {(row["planner"], row["goal_std_m"]): row["falls"] for row in pooled["rows"]
             if row["noise"]}
    surely = {row["goal_std_m"]: common.with_interval(row, "over_baseline_tuned")
              for row in pooled["rows"] if row["noise"] and row["planner"] == "policy"}
    kept = sum(promise["kept"] for promise in seeds["promises"])
    found = (
        f"""*A carrot is a strong opponent once all its settings are tuned* in the world they are
        used in: to near goals it needs {100 * carrot:.0f} % of the time that it needs with its
        team's settings. ({len(tuned["tried"])} settings were tried, and one of an earlier search.
        Of {sum("quiet" in row for row in tuned["finalists"])} safe finalists {tuned["rule"]} was
        kept; to stay: still there in {100 * FLOOR:.0f} % of the walks.)""",
        f"""*Search must take small steps,* as it does not know what one does after another: at
        full size it falls in {percent(bold["fall"])} of 200 walks; the fastest safe one of
        {len(search["tried"])} settings takes {100 * careful["factor"]:.0f} %, with
        {round(careful["fall"] * search["trials"])} falls in {search["trials"]:,}.""",
        f"""*To stay is harder than to pass through.* Search first touches a near goal after
        {hunts["time_once_mean"]:.1f} s and stays after {hunts["time_mean"]:.1f} s: it hunts around
        it.""",
        f"""*The paper's baseline shuffles:* it runs out of time in
        {percent(mean("timeout", "baseline", 0.5))} of {seeds["goals"]:,} other walks to near goals
        and {percent(mean("timeout", "baseline", 1))} to far ones; in the paper in 3 to 8 %.""",
        f"""*The policy wins by being quick, not by being safer.* Over three trainings its time is
        {mean("over_baseline_tuned", "policy", 0.5):.3f} (near) and
        {mean("over_baseline_tuned", "policy", 1):.3f} (far) of the tuned baseline's; it falls in
        {percent(mean("fall", "policy", 1))} of the far walks, that one in
        {percent(mean("fall", "baseline_tuned", 1))}, and we wanted 0.6 %. It keeps {kept} of our
        {len(seeds["promises"])} promises. In {pooled["goals"]:,} more walks a block the shipped one
        falls {often["policy", 0.5]} times near and {often["policy", 1]} far, the tuned baseline
        {often["baseline_tuned", 0.5]} and {often["baseline_tuned", 1]}; times {surely[0.5]} and
        {surely[1]}.""",
        f"""*Grip is dangerous.* On slippery ground (μ = 0.4) {percent(slow)} of the far walks end
        in a fall, where it holds (μ = 1) {percent(hard)}. Friction in the joints calms it:
        {joints["as trained"]} of 1,000 walks as drawn,
        {joints["no static friction in the joints"]} without.""",
        imu_finding())
    wrap = textwrap.TextWrapper(105, initial_indent="- ", subsequent_indent="  ")
    return "".join(wrap.fill(" ".join(text.split())) + "\n" for text in found)

def far_falls():
    """How often the policy falls on far goals in every world of the study `robustness`."""
    rows = common.read_json(common.RESULTS / "mujoco" / "studies" / "robustness.json")
    return {row["world"]: percent(row["fall"]) for row in rows
            if (row["planner"], row["goal_std_m"]) == ("policy", 1)}

def imu_rows():
    """Of the study `imu`, all trainings together: near, near with IMU, far, far with IMU."""
    rows = common.read_json(common.RESULTS / "mujoco" / "studies" / "imu.json")["rows"]
    return sorted((row for row in rows if row["seed"] is None),
                  key=lambda row: (row["goal_std_m"], row["planner"]))

def imu_finding():
    """What the IMU is worth."""
    near, near_imu, far, far_imu = imu_rows()
    return f"""*What an IMU is worth.* Policies that also feel the torso's tilt and turning fall
        {near_imu["falls"]} times in {near_imu["episodes"]:,} near walks and {far_imu["falls"]}
        times in as many far ones; those without, {near["falls"]} and {far["falls"]} times. Their
        times are {near_imu["time_ratio"]:.3f} and {far_imu["time_ratio"]:.3f} of the others'."""

def with_table(page, name, table):
    """A page with the text of today between its two comments."""
    begin, end = f"<!-- {name} -->\n", "<!-- end -->"
    head, rest = page.split(begin)
    return head + begin + table + end + rest.split(end, 1)[1]

def pages():
    """Every page as it should be, by its path."""
    found = {common.RESULTS / sim / "README.md": simulator_page(sim) for sim in SIMS}
    exercises, readme = common.ROOT / "tests" / "exercises", common.ROOT / "README.md"
    contest = exercises / "projects.md"
    field = judge.ranking(judge.noisy(common.RESULTS / "mujoco"))
    for page, name, table in ((readme, "table", readme_table()), (readme, "findings", findings()),
                              (contest, "contest", field)):
        old = found.get(page) or page.read_text(encoding="utf-8")
        found[page] = with_table(old, name, table)
    return found | {common.RESULTS / "STUDIES.md": studies_page()}

def main():
    """Writes them."""
    for path, text in pages().items():
        common.write(path, text)
        print("written:", path)

if __name__ == "__main__":
    try:
        main()
    except (common.StudyError, json.JSONDecodeError) as error:
        raise SystemExit(f"book: {error}") from error
