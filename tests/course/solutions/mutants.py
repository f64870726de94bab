"""Wrong solutions by rule: a function with one small mistake, for every place and every rule.

    for mistake, place, wrong in mutants(function): …    function: a node of `ast`, wrong: its source

`mistake` names the rule and what it changes, `place` is the statement, for the reader. Neither the
layout nor the names of local variables matter: `mistake` is the same with others.
"""

import ast
import copy

INSTEAD = {  # operators
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Lt: ast.Gt,
    ast.Gt: ast.Lt, ast.LtE: ast.Gt, ast.GtE: ast.Lt, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
PAIRS = "sin cos, arcsin arccos, minimum maximum, min max, mean sum, any all, low high"
OTHER = {a: b for pair in PAIRS.split(", ") for a, b in (pair.split(), pair.split()[::-1])}
ORDERED = ast.Sub, ast.Div, ast.MatMult, ast.Mod  # a − b is not b − a
SYMMETRIC = "clip minimum maximum min max hypot multiply swapaxes".split()  # f(a, b) = f(b, a)
SAME = "array asarray as_tensor float tuple list".split()  # f(x) holds the same numbers as x

# They train or search, with a mistake perhaps for ever: only the mistakes that begin like these
SLOW = {"improve": ("left of", "without U"), "steps_to_go": ()}
HARMLESS = {  # so many mistakes that compute the same, or that nobody should ask for
    "wrap: instead of Add": 1,  # half a turn ahead, or back
    "fallen: instead of cos": 1,  # sin 45° = cos 45°
    "leg_inverse: instead of 0": 1,  # a roll leaves the x axis where it is
    "leg_inverse: exchanged in a row": 1,  # y² + z²
    "leg_inverse: without minimum": 1,  # a long r: the cosine is clipped, too
    "leg_inverse: left of Pow alone": 1,
    "leg_inverse: right of Pow alone": 1,
    "reflex: instead of 1": 1,  # of reshape(-1, 12): NumPy takes every negative number so
    "to_action: instead of 1e-09": 1,  # no limits are closer than 0.1, but equal ones
    "_swing: instead of 1": 1,  # the time is at most 1
    "_swing: writes into what is given": 1,  # the engine does not use it any more
    "_knot: instead of Mult": 1,  # by a sign
    "reward_terms: exchanged in Sub": 1,  # squared
    "reward_terms: arguments exchanged": 1,
    "wilson: instead of 1.0": 1,  # only rounding makes more than 1
    "bootstrap: instead of 0": 1,  # another seed
    "highest_speed: exchanged in Sub": 1,  # of both signs
    "look_up: exchanged in a row": 2,  # corners in another order
    "log_beta_function: arguments exchanged": 1,  # B(α, β) = B(β, α)
    "beta_log_prob: exchanged in log_beta_function": 1,
    "beta_entropy: exchanged in log_beta_function": 1,
    "beta_entropy: arguments exchanged": 1,
    "beta_mode: instead of Add": 1,  # 0.5 is right wherever α = β
    "beta_mode: left of Add alone": 1,  # 0/0, where nobody looks
}


def changed(node, **fields):
    """A copy of a node with other fields."""
    new = copy.copy(node)
    vars(new).update(fields)
    return new


def neighbours(items):
    """The list with two neighbours exchanged, for all neighbours that differ."""
    for k in range(len(items) - 1):
        one, other = items[k : k + 2]
        if ast.dump(one) != ast.dump(other):
            yield [*items[:k], other, one, *items[k + 2 :]]


def in_call(call, variables):
    """The mistakes in a call, as of `mistakes`."""
    function, args = call.func, call.args
    name = getattr(function, "attr", getattr(function, "id", ""))
    owner = getattr(function, "value", None)
    while isinstance(owner, ast.Attribute):
        owner = owner.value
    # np.clip(x, …) is of a module, x.clamp(…) is of an array
    of_array = owner and (not isinstance(owner, ast.Name) or owner.id in variables)
    first = function.value if of_array else args[0] if args else None
    if first and name not in SAME and not isinstance(first, ast.Starred):
        yield f"without {name}", first
    if of_array and args:
        yield f"{name} over everything", changed(call, args=[])
    keep = args[: name in SYMMETRIC]
    for others in neighbours(args[len(keep) :]):
        yield f"exchanged in {name}", changed(call, args=[*keep, *others])


def mistakes(node, variables):
    """(rule and what it changes, the node that takes its place) for all that can go wrong here."""
    match node:
        case ast.BinOp(left=ast.Constant(value=0)):
            return  # 0 · x makes zeros of the same shape
        case ast.BinOp(left=left, op=op, right=right):
            kind = type(op).__name__
            yield f"left of {kind} alone", left
            yield f"right of {kind} alone", right
            if isinstance(op, ORDERED):
                yield f"exchanged in {kind}", changed(node, left=right, right=left)
            if type(op) in INSTEAD:
                yield f"instead of {kind}", changed(node, op=INSTEAD[type(op)]())
        case ast.Compare(ops=[op]) if type(op) in INSTEAD:
            yield f"instead of {type(op).__name__}", changed(node, ops=[INSTEAD[type(op)]()])
        case ast.UnaryOp(op=ast.USub() | ast.Invert() as op, operand=operand):
            if not isinstance(operand, ast.Constant):
                yield f"without {type(op).__name__}", operand
        case ast.Attribute(attr=name) if name in OTHER:
            yield f"instead of {name}", changed(node, attr=OTHER[name])
        case ast.Name(id=name) if name in OTHER and name not in variables:
            yield f"instead of {name}", changed(node, id=OTHER[name])
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            more = value + 1 if isinstance(value, int) else 2 * value + 0.1
            yield f"instead of {value}", ast.Constant(more)
        case ast.IfExp(body=body, orelse=orelse):
            yield "the other case", changed(node, body=orelse, orelse=body)
        case ast.List(elts=elements) | ast.Tuple(elts=elements):
            for other in neighbours(elements):
                yield "exchanged in a row", changed(node, elts=other)
        case ast.Dict(values=values):
            for other in neighbours(values):
                yield "exchanged by name", changed(node, values=other)
        case ast.Call():
            yield from in_call(node, variables)
        case ast.Assign(targets=[ast.Subscript()]) | ast.AugAssign():
            yield "a statement left out", ast.Pass()


class Replace(ast.NodeTransformer):
    """Puts a node in the place of another one."""

    def __init__(self, old, new):
        self.old, self.new = old, new

    def visit(self, node):
        return self.new if node is self.old else self.generic_visit(node)


def about_arguments(function, used):
    """(rule, lines around its body) for what can go wrong with the arguments that are used."""
    arguments = function.args
    plain = [one.arg for one in arguments.posonlyargs + arguments.args]
    names = [name for name in plain + [one.arg for one in arguments.kwonlyargs] if name in used]
    defaults = [*zip(plain[::-1], arguments.defaults[::-1])]
    defaults += [
        (one.arg, value) for one, value in zip(arguments.kwonlyargs, arguments.kw_defaults)
    ]
    for one, other in zip(names, names[1:]):
        yield "arguments exchanged", f"{one}, {other} = {other}, {one}"
    for name, value in defaults:
        if name in used and value:
            yield "always as by default", f"{name} = {ast.unparse(value)}"
    for name in names:
        yield "the first one for all", f"{name} = {name}[[0] * len({name})]"
        yield "writes into what is given", f"try: pass\nfinally: {name}[...] *= 0"


def mutants(function, since=""):
    """(mistake, place, source of the function with it), for all of its body or from the statement
    on that begins like `since`."""
    function = copy.deepcopy(function)
    body = function.body[1 if ast.get_docstring(function) else 0 :]
    first = next(k for k, line in enumerate(body) if ast.unparse(line).startswith(since))
    nodes = [(node, line) for line in body[first:] for node in ast.walk(line)]
    used = {node.id for node, _ in nodes if isinstance(node, ast.Name)} - {"self"}
    local = {
        node.id
        for node, _ in nodes
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }
    local |= {one.arg for one in ast.walk(function) if isinstance(one, ast.arg)}
    indices = [node.slice for node, _ in nodes if isinstance(node, ast.Subscript)]
    for old, line in nodes:
        if isinstance(old, ast.Tuple) and old in indices:
            continue
        place = ast.unparse(line)
        for mistake, new in mistakes(old, local):
            Replace(old, new).visit(function)
            yield mistake, place, ast.unparse(function)
            Replace(new, old).visit(function)
    for mistake, lines in about_arguments(function, used):
        (*_, last) = around = ast.parse(lines).body
        rest = body[first:]
        if isinstance(last, ast.Try):
            last.body, rest = rest, []
        function.body = [*body[:first], *around, *rest]
        yield mistake, lines, ast.unparse(function)
