"""What the studies share: the command line, files, tables, and walks to many goals.

    python tests/studies/common.py     puts the tables of results/ into the pages that show them

A study is a file with DURATION, PARTS (functions that measure something and return rows of plain
numbers, or a dict with `rows` and more; some ONLY_3D), COLUMNS of a table for each part or `table` (Markdown of all
numbers), and mostly PICTURES (of which part, and what draws them). It writes NAME.json, NAME.md and
pictures. A part is written as soon as it is finished; --only measures one part again. What the
numbers say is written by hand into the pages; `test_numbers.py` compares its numbers.
"""

import itertools
import json
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "results"
sys.path.append(str(ROOT))  # the stages; a script finds only what is in its own folder
robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")
env = import_module("03_env")
ppo = import_module("04_ppo")
evaluate = import_module("05_evaluate")

COLORS = {  # figures
    "policy": "tab:purple",
    "expert": "tab:brown",
    "baseline_tuned": "tab:olive",
    "baseline": "k",
}
NO_ANSWERS = {"reflex": 0.0, "capture": 0.0, "wait": 0.0}  # a walk in open loop
CAPTIONS = {  # of the pictures: what to see, of how many walks, where to look
    "baseline": "Near and far goals, 2,000 walks a mark, and 1,000 far ones with pushes. A full "
    "mark keeps the rule. A hollow one breaks it: too many falls, or too seldom *still there*. "
    "Large: chosen; if none keeps the rule, the one with the fewest points. One triangle and one square are from before the searches.",
    "baseline.search": "Each line is a search: the least mean of a generation of 12 candidates so far. "
    "Points are seconds; falls and time-outs have a price.",
    "kicks": "Far walks of the policy with pushes every 3 s on average, black: 95 % intervals. (0.4 m/s is what a "
    "push would give the torso alone: 1.4 N s, 0.23 m/s of the robot.) Compare each answer that is left out with "
    "all of them. With no answer, not even the reflex, it falls most often.",
    "ladder": "The learner of stage 4, and four learners that lack one part: the mean of five seeds, "
    "and its 95 % interval. The higher, the better: see how far below the green curve the others end.",
    "ladder.rungs": "From the paper's system (above) to ours (below), 500 near goals with noise; a circle is one "
    "training, a number the mean of three. See what each change brings, and how far `baseline` gets if it is only tuned.",
    "peers": "Three trainings with each learner, with the same settings, a quarter as long as the shipped one. "
    "Can you tell the learners apart? (At first only short walks have ended; where a line dips, few had arrived.)",
    "seeds": "Any direction and yaw, with noise, 200 walks a point, 95 % intervals of each difference (without "
    "pairs, so too wide). Above 0 the policy is quicker.",
    "walk": "Each cell: eight robots take eight double steps; the darker, the more of them fall. Green: "
    "the step limits. They were chosen so that most cells inside are white; in the corners some robots "
    "fall. (The yaw is drawn to the smaller of its two limits, since both feet turn alike.)",
    "walk.tune": "Each line is a search: the least mean of a generation of 12 candidates so far. Worlds "
    "differ from generation to generation, so some of the gain is luck. Does a line still go down at its end?",
}
PER_FALL = 200  # [s] points of a contest per share of the walks
PER_TIMEOUT = 100  # the same
CANDIDATES = 12  # in a generation of a search
PER_SET = 500  # robots of a world, so goals in a set
STD = {False: env.Task().goal_std_m, True: env.Task().far_std_m}  # [m] of near and of far goals


def arguments(study, argv=None, **flags):
    """Returns a study's arguments, and prints how long it takes; flags: see `add_argument`."""
    parser = robot_model.stage_parser(study.__doc__)
    for name, flag in flags.items():
        parser.add_argument(f"--{name}", **flag)
    args = parser.parse_args(argv)
    args.out = robot_model.output_folder(args, "studies")
    print(f"{study.__name__}, {args.sim}: {study.DURATION}", flush=True)
    return args


def main(name, argv=None):
    """The command line of a study; it is imported by its name, as its own processes do."""
    study = import_module(name)
    only = {"choices": study.PARTS, "help": "measure this part, leave the others"}
    args = arguments(study, argv, only=only, **getattr(study, "FLAGS", {}))
    for part in [args.only] if args.only else study.PARTS:
        if args.sim == "pymunk" and part in getattr(study, "ONLY_3D", ()):
            print(f"{part}: only in 3-D, --mujoco")
        else:
            publish(study, part, args)


def start(name):
    """What a study does as a script."""
    robot_model.run_script(lambda: main(name))


def publish(study, part, args):
    """Measures a part of a study, then writes all that is known."""
    path = args.out / f"{study.__name__}.json"
    numbers = study.PARTS[part](args)
    if numbers is None:  # it was left out, and has said why
        return
    found = {"rows": numbers} if isinstance(numbers, list) else numbers
    found = ppo.as_json((read_json(path) if path.is_file() else {}) | {part: found})
    text = json.dumps(found, indent=1, ensure_ascii=False, allow_nan=False)
    robot_model.write_text(path, text + "\n")
    for name, (shown, draw) in getattr(study, "PICTURES", {}).items():
        if shown in found:
            robot_model.save_figure(draw(found, args.sim), args.out / f"{name}.png")
    robot_model.write_text(path.with_suffix(".md"), page(study, found, path))
    print(f"\n{tables(study, found)}\nwritten to {args.out}")


def page(study, found, path):
    """The text of a study's page: what it asks, the tables of its numbers, and its pictures."""
    question, name = study.__doc__.partition("\n")[0], path.stem
    link = f"[{name}.py](../../../tests/studies/{name}.py)"
    head = f"# {question}\n\nMeasured by {link}: its head tells what, its constants seeds and goals.\n\n"
    pictures = sorted(path.parent.glob(f"{path.stem}*.png"))
    shown = (f"\n![{p.stem}]({p.name})\n*{CAPTIONS[p.stem]}*\n" for p in pictures)
    return "".join([head, tables(study, found), *shown])


def tables(study, found):
    """A study's table, or one with its COLUMNS for each part."""
    return study.table(found) if hasattr(study, "table") else sections(found, study.COLUMNS)


def read_json(path):
    """Returns the content of a file that a study, or stage 5, has written."""
    try:
        return json.loads(path.read_text("utf-8"))
    except ValueError as error:
        raise robot_model.InputError(f"{path}: damaged ({error}); delete it") from error


def work(sim, study, training):
    """Returns the folder of a study's training; what is in it stays until you delete it."""
    folder = Path("runs", sim, "studies", study, training)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


HEADS = {
    "goal_std_m": "goals σ [m]",
    "success": "arrived",
    "fall": "share of falls",
    "timeout": "share of time-outs",
    "time": "time [s]",
    "time_mean": "time [s]",
    "over_baseline_tuned": "time ÷ baseline_tuned",
    "over_baseline_scaled": "time ÷ baseline_scaled",
    "over_expert": "time ÷ expert",
    "ratio": "time of all trainings ÷ its",
    "seed": "training seed",
    "distance": "distance [m]",
    "push": "push [m/s]",
    "still_there": "still there",
    "time_over_all": "time ÷ that with all",
    "per_seed": "÷ that with all, by seed",
    "only_theirs": "falls avoided",
    "only_ours": "new falls",
}
KINDS = {STD[False]: "near", STD[True]: "far"}  # goals, in the columns that `beside` makes


def table(rows, columns):
    """Rows (dicts) in Markdown; columns: {key: digits of a number}, those that a row has."""
    columns = {key: columns[key] for key in columns if any(key in row for row in rows)}
    head = [key if ", " in key else HEADS.get(key, key.replace("_", " ")) for key in columns]
    lines = [" | ".join(cell(row, *column) for column in columns.items()) for row in rows]
    return evaluate.markdown(" | ".join(head), lines)


def beside(rows, columns):
    """Rows and columns of a wider table: a key ("falls", "planner") becomes a column for each planner.

    Rows with the same values under the keys before the first such pair become one row.
    """
    same = list(itertools.takewhile(lambda key: isinstance(key, str), columns))
    if len(same) == len(columns):
        return rows, columns
    lines, wide = {}, {}
    for key, digits in columns.items():
        for row in rows:
            line = lines.setdefault(tuple(row[name] for name in same), dict(row))
            if isinstance(key, str):
                wide[key] = digits
                continue
            value, name = key
            column = f"{HEADS.get(value, value)}, {KINDS.get(row[name], row[name])}"
            wide[column] = digits
            line |= {column: row[value], f"{column}_ci95": row.get(f"{value}_ci95")}
    return [*lines.values()], wide


def sections(found, columns):
    """A heading and a table of its rows for every part that is there; columns by part."""
    parts = {part: beside(found[part]["rows"], columns[part]) for part in columns if part in found}
    return "\n".join(f"### {part}\n\n{table(*wide)}" for part, wide in parts.items())


def cell(row, key, digits):
    """A value of a row as text, with its 95 % interval if the row has one."""
    value = row.get(key, "")
    if value is None:
        return "none"  # there was nothing to measure
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (str, int)):
        return str(value)
    text = f"{value:.{digits}f}"
    if row.get(f"{key}_ci95"):  # of few pairs there is none
        low, high = row[f"{key}_ci95"]
        text += f" [{low:.{digits}f}, {high:.{digits}f}]"
    return text


def fell(ended):
    """In which walks the robot fell, bool [n]."""
    return ended["outcome"] == "fall"


def pick(rows, **wanted):
    """The rows with these values."""
    return [row for row in rows if wanted.items() <= row.items()]


def values(rows, key, **wanted):
    """What the rows with these values have under a key."""
    return [row[key] for row in pick(rows, **wanted)]


def opponents(sim):
    """The best two planners that do not learn, by name."""
    return {
        "baseline_tuned": evaluate.BaselinePlanner(evaluate.TUNED_BASELINE[sim]),
        "expert": evaluate.load_planner(ROOT / "tests" / "studies" / "expert.py"),
    }


def policy(path, sim):
    """The planner of a policy file."""
    return evaluate.policy_planner(path, world(sim, num_robots=1))


def shipped(sim):
    """The planner of the shipped policy."""
    return policy(RESULTS / sim / "policy.pt", sim)


def trainings(sim):
    """The planners of all trainings that differ in their seed, by seed."""
    folders = sorted((RESULTS / sim / "seeds").glob("*"))
    return {int(folder.name): policy(folder / "policy.pt", sim) for folder in folders}


def world(sim, kind=env.FootstepWorld, num_robots=PER_SET, noise=True, **settings):
    """Returns a FootstepWorld for `walks`."""
    return kind(num_robots, sim, noise, **settings)


def walks(planner, world, far=False, sets=1, first=1, per_set=None, purpose="evaluation"):
    """Returns arrays [sets · per_set] as `evaluate` does, for the seeds first, first + 1, …

    A set has one goal for each robot of the world, or fewer. Seeds from 120 on judge what the
    studies have chosen, see `seeds.py`.
    """
    parts = []
    for seed in tqdm(range(first, first + sets), unit=" sets", leave=False):
        trials = evaluate.draw_trials(seed, per_set or len(world.goal), far, purpose)
        parts.append(evaluate.evaluate(planner, world, trials))
    return together(parts)


def measured(sim, planners, far, sets, first, settings, **more):
    """Rows of these planners, by name, in a world with these settings; more: values before theirs."""
    one, rows = world(sim, **settings), []
    for name, planner in planners.items():
        rows.append(row_of(walks(planner, one, far, sets, first), name, far, **more))
    return rows


def near_and_far(planner, world, **more):
    """`walks` to near goals, then to far ones."""
    return together([walks(planner, world, far, **more) for far in STD])


def together(parts):
    """The walks of all parts as one."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def row_of(ended, name, far=False, **more):
    """A row of stage 5's table, walked with noise, with more values before it and how many walks
    ended with a fall behind it; None: nothing to measure, for JSON knows no nan."""
    row = more | evaluate.summary(name, True, STD[far], ended) | {"falls": int(fell(ended).sum())}
    return {key: None if value != value else value for key, value in row.items()}


def time_over(name, ended, reference):
    """The mean time relative to that of other walks to the same goals, and its interval, under this
    name; None: too few goals were reached in both."""
    ratio = evaluate.time_ratio(ended, reference)
    found = {end: ratio.get(f"time_ratio{end}", np.nan) for end in ("", "_ci95")}
    return {f"{name}{end}": None if np.isnan(x).any() else x for end, x in found.items()}


def subplots(*shape, figsize, **shared):
    """A figure, and its axes."""
    figure = Figure(figsize)
    return figure, figure.subplots(*shape, **shared)


def cma_es(costs, mean, spread, population, rng, low=-np.inf, high=np.inf):
    """Covariance matrix adaptation (N. Hansen: The CMA Evolution Strategy: A Tutorial, 2016, arXiv
    1604.00772): draws candidates from a normal distribution, and moves it to the best half of them.

    costs(generation, drawn [population, n]) -> [population] is to be made small; None ends the
    search. mean, spread, low, high [n]: where it begins, the first standard deviations, the limits.
    Returns the last mean [n]. Names and constants are those of the tutorial.
    """
    n, mean = len(mean), np.array(mean, float)
    weights = np.log((population + 1) / 2) - np.log(np.arange(1, population // 2 + 1))
    weights /= weights.sum()
    mu_eff = 1 / (weights**2).sum()
    c_s = (mu_eff + 2) / (n + mu_eff + 5)
    d_s = 1 + 2 * max(0, ((mu_eff - 1) / (n + 1)) ** 0.5 - 1) + c_s
    c_c = (4 + mu_eff / n) / (n + 4 + 2 * mu_eff / n)
    c_1 = 2 / ((n + 1.3) ** 2 + mu_eff)
    c_mu = min(1 - c_1, 2 * (mu_eff - 2 + 1 / mu_eff) / ((n + 2) ** 2 + mu_eff))
    chi = n**0.5 * (1 - 1 / (4 * n) + 1 / (21 * n**2))  # E‖N(0, I)‖
    sigma, C, p_s, p_c = 1.0, np.eye(n), np.zeros(n), np.zeros(n)
    for generation in itertools.count():
        values, B = np.linalg.eigh(C)  # C = B·D²·Bᵀ
        D = np.sqrt(np.maximum(values, 1e-12))
        drawn = mean + sigma * spread * (rng.normal(size=(population, n)) * D @ B.T)
        drawn = np.clip(drawn, low, high)
        found = costs(generation, drawn)
        if found is None:
            return mean
        best = drawn[np.argsort(found)[: len(weights)]]
        steps = (best - mean) / (sigma * spread)  # in units of the first spread
        step = weights @ steps
        mean = mean + sigma * spread * step
        # Evolution paths: do steps in a row go the same way? Then sigma grows, and C along p_c.
        p_s = (1 - c_s) * p_s + (c_s * (2 - c_s) * mu_eff) ** 0.5 * B @ (B.T @ step / D)
        length = np.linalg.norm(p_s)
        usual = (1 - (1 - c_s) ** (2 * generation + 2)) ** 0.5 * (1.4 + 2 / (n + 1)) * chi
        p_c = (1 - c_c) * p_c + (length < usual) * (c_c * (2 - c_c) * mu_eff) ** 0.5 * step
        C = (1 - c_1 - c_mu) * C + c_1 * np.outer(p_c, p_c) + c_mu * (weights * steps.T) @ steps
        sigma *= np.exp(c_s / d_s * (length / chi - 1))


def search(walked, cost, mean, spread, budget, seed, low=-np.inf, high=np.inf):
    """A search by `cma_es`, until its candidates have taken so many double steps.

    walked(drawn [candidates, n], trial) -> a list of what `evaluate` returns; cost(such an element) ->
    the number to be made small. In a generation all candidates walk in the same worlds, those of a
    number `trial`; in the next one in others.
    Returns the last mean [n], and a row for each generation.
    """
    rows, taken = [], 0

    def costs(generation, drawn):
        nonlocal taken
        if taken >= budget:
            return None
        ends = walked(drawn, 1000 * (1 + seed) + generation)
        found = [cost(ended) for ended in ends]
        taken += sum(int(ended["steps"].sum()) for ended in ends)
        row = {"restart": seed, "steps": taken, "mean": float(np.mean(found))}
        falls = sum(int(fell(ended).sum()) for ended in ends)
        rows.append(row | {"best": float(min(found)), "falls": falls})
        print(rows[-1], flush=True)
        return found

    return cma_es(costs, mean, spread, CANDIDATES, np.random.default_rng(seed), low, high), rows


def plot_searches(found, sim):
    """Draws for each search of every part the least mean points of a generation so far."""
    parts = sorted(part for part in found if "curve" in found[part])
    figure, panels = subplots(1, len(parts), figsize=(9, 4), sharey=True, squeeze=False)
    for axes, part in zip(panels[0], parts):
        curve = found[part]["curve"]
        for restart in dict.fromkeys(values(curve, "restart")):
            own = pick(curve, restart=restart)
            steps = np.array(values(own, "steps")) / 1000
            best = np.minimum.accumulate(values(own, "mean"))
            ls = ("-", "--", ":", "-.")[restart % 4]
            axes.step(steps, best, where="post", ls=ls, label=f"search {restart + 1}")
        axes.set(xlabel="double steps [thousands]", xlim=(0, None))
        axes.set_title(part if len(parts) > 1 else "")
        axes.legend()
    panels[0, 0].set_ylabel("points: time and price of falls [s], best so far")
    return figure


def calm_and_pushed(planners, worlds, trial):
    """Lets each planner walk in all these worlds, half of the robots to near and half to far goals of
    this number of the tuning stream. Returns a list of what `evaluate` does, of all together."""
    trials = []
    for one in worlds:
        half = len(one.goal) // 2
        goals = [evaluate.draw_trials(trial, half, far, "tuning").goals for far in STD]
        trials.append(evaluate.Trials(np.concatenate(goals), trial, "tuning"))
    ends = []
    for planner in planners:
        walked = [evaluate.evaluate(planner, one, own) for one, own in zip(worlds, trials)]
        ends.append(together(walked))
    return ends


WHAT = {  # README's planners, and what they are
    "policy": "the trained network",
    "baseline_tuned": "the team's controller, tuned for this robot",
    "expert": "our own planner, tuned: brakes late, turns as it walks",
    "baseline": "the team's controller, with the team's settings",
}


def planners_table(rows):
    """README's table of planners, from the rows of evaluation.json."""
    lines = []
    for name, what in WHAT.items():
        near, far = pick(rows, planner=name, noise=True)
        lines.append(
            {
                "planner": f"`{name}`",
                "what it is": what,
                "near [s]": near["time_mean"],
                "far [s]": far["time_mean"],
                f"falls of {near['episodes']}": "{:.0f}, {:.0f}".format(
                    *(row["fall"] * row["episodes"] for row in (near, far))
                ),
                "still there": f"{near['still_there']:.2f}, {far['still_there']:.2f}",
            }
        )
    return table(lines, dict.fromkeys(lines[0], 2))


def pasted(text, mark, part):
    """Returns the text of a page with this part behind its mark."""
    begin, end = f"<!-- {mark} -->\n", "<!-- end -->"
    head, rest = text.split(begin)
    return head + begin + part + end + rest.split(end, 1)[1]


def read_trials(path):
    """The lines of a trials.csv, by (planner, noise, σ of the goals), each as an array with names."""
    yes = dict.fromkeys(("noise", "still_there"), lambda cell: cell == "yes")
    table = {"delimiter": ",", "names": True, "encoding": "utf-8", "converters": yes}
    lines = np.genfromtxt(path, dtype=None, **table)
    kinds = lines[["planner", "noise", "goal_std_m"]].tolist()
    return {kind: lines[[other == kind for other in kinds]] for kind in dict.fromkeys(kinds)}


def pages():
    """{path: text as it should be} of the pages with tables of results/."""
    found = {
        path.with_suffix(".md"): page(import_module(path.stem), read_json(path), path)
        for path in RESULTS.glob("*/studies/*.json")
    }
    planners = planners_table(read_json(RESULTS / "mujoco/evaluation.json")["rows"])
    marked = [(ROOT / "README.md", "result", planners)]
    for path in RESULTS.glob("*/evaluation.json"):
        evaluation = read_json(path)
        tables = evaluate.table(evaluation["rows"], evaluation["ratios"])
        marked.append((path.with_name("README.md"), "evaluation", tables))
    return found | {file: pasted(file.read_text("utf-8"), *part) for file, *part in marked}


def main_pages():
    """Writes the pages, and says which have changed."""
    for path, text in pages().items():
        if text != path.read_text("utf-8"):
            robot_model.write_text(path, text)
            print("written:", path)


if __name__ == "__main__":
    robot_model.run_script(main_pages)
