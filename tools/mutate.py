"""Mutation testing: each of many small errors put into a module must turn one of its tests red.

A mutant lives in the memory of a child that runs the module's tests; the working tree is never
changed. The child is forked from a process that has imported what takes long and has started no
renderer, whose threads no fork survives.

    python tools/mutate.py --modules fit.trust.guard contract.camera --count 20

Two libraries were tried first. mutmut could not collect these tests, and forks after it has run
them, renderer and all; cosmic-ray changes the files in place, changes numbers by one only, and pays
seconds of imports for each mutant.
"""

from __future__ import annotations

import argparse
import ast
import copy
import importlib
import importlib.machinery
import json
import os
import random
import signal
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parent.parent
FIT, CONTRACT = "tests/backend/fit/", "tests/contract/"
# By module of ``facestage``: the tests that speak of it, the quick ones first.
TESTS: dict[str, tuple[str, ...]] = {
    "contract.brdf": (CONTRACT + "test_constants.py", "tests/backend/render/test_brdf.py"),
    **{
        f"contract.{name}": (CONTRACT + "test_constants.py", f"{CONTRACT}test_{name}.py")
        for name in ("camera", "events", "landmarks", "light_stage", "pins", "quality")
    },
    "contract.files.array_archive": (
        CONTRACT + "files/test_storage.py",
        CONTRACT + "files/test_array_archive.py",
    ),
    "contract.files.atomic": (
        CONTRACT + "files/test_storage.py",
        CONTRACT + "files/test_atomic.py",
    ),
    "contract.files.json_text": (CONTRACT + "files/test_json_text.py",),
    "contract.files.paths": (CONTRACT + "files/test_paths.py",),
    "contract.files.reading": (
        CONTRACT + "files/test_reading.py",
        CONTRACT + "files/test_json_text.py",
        CONTRACT + "files/test_storage.py",
    ),
    "contract.files.storage": (CONTRACT + "files/test_storage.py",),
    "contract.parameters": (
        CONTRACT + "test_parameters.py",
        CONTRACT + "test_person.py",
        CONTRACT + "test_result.py",
    ),
    "contract.files.partial": (CONTRACT + "files/test_partial.py",),
    "contract.result": (CONTRACT + "test_result.py", CONTRACT + "test_tampered_result.py"),
    "contract.result_files": (CONTRACT + "test_result_files.py", CONTRACT + "files/test_atomic.py"),
    "contract.schemas.array_field": (
        CONTRACT + "schemas/test_array_field.py",
        CONTRACT + "schemas/test_schema.py",
    ),
    "contract.schemas.fields": (
        CONTRACT + "schemas/test_fields.py",
        CONTRACT + "schemas/test_schema.py",
    ),
    "contract.schemas.schema": (CONTRACT + "schemas/test_schema.py",),
    "contract.wording": (CONTRACT + "test_wording.py", CONTRACT + "schemas/test_schema.py"),
    **{
        f"contract.{name}": (f"{CONTRACT}test_{name}.py",)
        for name in ("face_model", "job", "person", "relight_cache", "rig_file")
    },
    "fit.trust.checks": (
        FIT + "trust/test_checks_values.py",
        FIT + "trust/test_guard_values.py",
        FIT + "trust/test_guard.py",
    ),
    "fit.solve.descent": (FIT + "solve/test_descent.py",),
    "fit.energy.pin_term": (FIT + "energy/test_pin_term.py",),
    "fit.energy.photo_term": (
        FIT + "energy/test_energy_values.py",
        FIT + "energy/test_photo_jacobian.py",
        FIT + "energy/test_plan.py",
    ),
    "fit.energy.energy": (FIT + "energy/test_energy.py", FIT + "energy/test_energy_values.py"),
    "fit.energy.robust_residuals": (
        FIT + "energy/test_landmark_term_values.py",
        FIT + "energy/test_silhouette_values.py",
        FIT + "energy/test_energy.py",
    ),
    "fit.trust.guard": (FIT + "trust/test_guard_values.py", FIT + "trust/test_guard.py"),
    "fit.energy.landmark_term": (
        FIT + "energy/test_landmark_term_values.py",
        FIT + "energy/test_landmark_term.py",
        FIT + "face/test_contour_lines.py",
    ),
    "fit.energy.noise": (FIT + "energy/test_noise_values.py", FIT + "energy/test_noise.py"),
    "fit.energy.normal_equations": (FIT + "energy/test_normal_equations.py",),
    "fit.energy.photo_jacobian": (
        FIT + "energy/test_photo_jacobian_values.py",
        FIT + "energy/test_normal_equations.py",
        FIT + "energy/test_photo_jacobian.py",
    ),
    "fit.energy.plan": (FIT + "energy/test_energy_values.py", FIT + "energy/test_plan.py"),
    "fit.energy.priors": (FIT + "energy/test_priors_values.py", FIT + "energy/test_priors.py"),
    "fit.stages.photo_descent": (
        FIT + "stages/test_photo_descent_values.py",
        FIT + "stages/test_recovery.py",
    ),
    "fit.energy.shadow_edges": (
        FIT + "energy/test_shadow_edges_values.py",
        FIT + "energy/test_shadow_edges.py",
    ),
    "fit.energy.edge_search": (FIT + "energy/test_edge_search.py",),
    "fit.energy.outline": (FIT + "energy/test_outline.py",),
    "fit.energy.silhouette": (
        FIT + "energy/test_silhouette_values.py",
        FIT + "energy/test_silhouette.py",
    ),
    "fit.solve.bounded_step": (FIT + "solve/test_bounded_step.py",),
}
HEAVY = (
    "numpy",
    "scipy.linalg",
    "scipy.ndimage",
    "scipy.sparse",
    "scipy.spatial.transform",
    "scipy.optimize",
    "scipy.interpolate",
    "skimage",
    "PIL.Image",
    "marshmallow",
    "hypothesis",
    "pytest",
    "cv2",
)
OPTIONS = (
    "-q",
    "-x",
    "-p",
    "no:cacheprovider",
    "--tb=line",
    "-W",
    "ignore::pytest.PytestAssertRewriteWarning",
)
SECONDS = 120.0  # a mutant that takes longer hangs
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.Mod: ast.Mult,
}
# Each comparison becomes its neighbor and its opposite.
COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}


@dataclass(frozen=True)
class Mutant:
    """One change of a module: the number of the node in :func:`ast.walk`'s order, and which of its
    changes.
    """

    module: str
    node: int
    variant: int
    line: int
    words: str
    survived: bool | None = None
    seconds: float = 0.0


def variants(node: ast.AST) -> list[tuple[str, ast.AST]]:
    """What a node may become, in words and as what takes its place."""
    found: list[tuple[str, ast.AST]] = []

    def add(changed: ast.AST) -> None:
        found.append((f"{ast.unparse(node)} -> {ast.unparse(changed) or 'nothing'}"[:160], changed))

    def changed(**fields: object) -> ast.AST:
        result = copy.deepcopy(node)
        for name, value in fields.items():
            setattr(result, name, value)
        return result

    if isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in ARITHMETIC:
        add(changed(op=ARITHMETIC[type(node.op)]()))
    elif isinstance(node, ast.BoolOp):
        add(changed(op=ast.Or() if isinstance(node.op, ast.And) else ast.And()))
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        for other in COMPARISONS[type(node.ops[0])]:
            add(changed(ops=[other()]))
    elif isinstance(node, ast.UnaryOp):
        add(node.operand)
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        add(ast.Constant(not node.value))
    elif isinstance(node, ast.Constant) and isinstance(node.value, int):
        add(ast.Constant(node.value + 1))
    elif isinstance(node, ast.Constant) and isinstance(node.value, float):
        add(ast.Constant(2 * node.value if node.value else 1.0))
        add(ast.Constant(0.5 * node.value if node.value else -1.0))
    elif isinstance(node, ast.If | ast.IfExp):
        add(changed(test=ast.UnaryOp(ast.Not(), node.test)))
    elif isinstance(node, ast.Return) and node.value is not None:
        add(ast.Return(ast.Constant(None)))
    elif isinstance(node, ast.Expr | ast.AugAssign) or (
        isinstance(node, ast.Assign) and not isinstance(node.targets[0], ast.Name | ast.Tuple)
    ):
        add(ast.Pass())
    return found


def skipped(tree: ast.Module) -> set[int]:
    """Nodes (by id) whose change no test could see: docstrings, annotations, messages of errors,
    fields' defaults.
    """
    result: set[int] = set()
    for node in ast.walk(tree):
        hidden: list[ast.AST | None] = []
        if isinstance(node, ast.FunctionDef):
            arguments = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
            hidden += [
                node.returns,
                *(argument.annotation for argument in arguments),
                *node.decorator_list,
            ]
        elif isinstance(node, ast.AnnAssign):
            hidden.append(node.annotation)
        text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if text or isinstance(node, ast.JoinedStr | ast.Assert):
            hidden.append(node)
        if (
            isinstance(node, ast.If)
            and isinstance(node.test, ast.Name)
            and node.test.id == "TYPE_CHECKING"
        ):
            hidden.append(node)
        for one in hidden:
            if one is not None:
                result |= {id(inner) for inner in ast.walk(one)}
    return result


def mutants(module: str, source: str) -> list[Mutant]:
    """Every mutant of a module's source."""
    tree = ast.parse(source)
    hidden = skipped(tree)
    return [
        Mutant(module, number, variant, getattr(node, "lineno", 0), words)
        for number, node in enumerate(ast.walk(tree))
        if id(node) not in hidden
        for variant, (words, _) in enumerate(variants(node))
    ]


def mutated(source: str, mutant: Mutant) -> ast.Module:
    """The module with the mutant's one change."""
    tree = ast.parse(source)
    wanted = list(ast.walk(tree))[mutant.node]
    new = variants(wanted)[mutant.variant][1]
    for parent in ast.walk(tree):
        for name, value in ast.iter_fields(parent):
            if value is wanted:
                setattr(parent, name, new)
            elif isinstance(value, list) and any(item is wanted for item in value):
                value[[item is wanted for item in value].index(True)] = new
    return ast.fix_missing_locations(tree)


def put_in_place(path: Path, source: str) -> None:
    """Let this process import ``source`` wherever it would import the file ``path``.

    Below all hooks of imports, so that what checks the annotations of calls checks the mutant's.
    """
    loader = importlib.machinery.SourceFileLoader
    get_data, path_stats = loader.get_data, loader.path_stats

    def data_of(self: Any, name: str) -> bytes:
        return source.encode() if name == str(path) else get_data(self, name)

    def stats_of(self: Any, name: str) -> Any:
        if name == str(path):
            raise FileNotFoundError(name)  # so that no compiled file is asked for
        return path_stats(self, name)

    patched: Any = loader
    patched.get_data, patched.path_stats = data_of, stats_of


def survives(tests: Sequence[str], tree: ast.Module, path: Path, log: Path) -> tuple[bool, float]:
    """Whether ``tests`` stay green over the mutated ``tree``, and the seconds it took; a hang is
    red.
    """
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.setsid()
            stream = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(stream, 1)
            os.dup2(stream, 2)
            put_in_place(path, ast.unparse(tree))
            import pytest

            code = int(pytest.main([*OPTIONS, *tests]))
        finally:
            if error := sys.exception():
                traceback.print_exception(error)
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    while time.monotonic() - began < SECONDS:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status == 0, time.monotonic() - began
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False, time.monotonic() - began


def chosen(module: str, source: str, count: int, seed: int) -> list[Mutant]:
    """At most ``count`` mutants of a module, the same ones for the same seed, by line."""
    found = mutants(module, source)
    if len(found) > count:
        found = random.Random(f"{seed} {module}").sample(found, count)
    return sorted(found, key=lambda mutant: (mutant.line, mutant.node, mutant.variant))


def examine(module: str, count: int, seed: int, root: Path, log: Path) -> Iterator[Mutant]:
    """The chosen mutants of a module, each with whether it survived.

    Raises SystemExit where the tests are red.
    """
    path = root / "backend" / "facestage" / f"{module.replace('.', '/')}.py"
    source = path.read_text(encoding="utf-8")
    tests = [test for test in TESTS[module] if (root / test).is_file()]
    if not tests:
        raise SystemExit(f"{module} has no tests in {root}.")
    green, _ = survives(tests, ast.parse(source), path, log)
    if not green:
        raise SystemExit(f"The tests of {module} are red without any mutant; see {log}.")
    for mutant in chosen(module, source, count, seed):
        survived, seconds = survives(tests, mutated(source, mutant), path, log)
        yield Mutant(
            module, mutant.node, mutant.variant, mutant.line, mutant.words, survived, seconds
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """Examine the modules, print the survivors and a table, and keep every mutant in a file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--modules", nargs="*", default=sorted(TESTS), help="modules of facestage; all by default"
    )
    parser.add_argument("--count", type=int, default=40, help="mutants per module at most (40)")
    parser.add_argument("--seed", type=int, default=0, help="which mutants are drawn (0)")
    parser.add_argument(
        "--out", type=Path, default=REPOSITORY / "build" / "mutants", help="folder for the outcome"
    )
    parser.add_argument(
        "--root", type=Path, default=REPOSITORY, help="another working tree to examine"
    )
    given = parser.parse_args(arguments)
    out, root = given.out.resolve(), given.root.resolve()
    out.mkdir(parents=True, exist_ok=True)
    os.chdir(root)
    sys.path[:0] = [str(root / "backend"), str(root / "addon")]
    for name in HEAVY:
        importlib.import_module(name)
    table = []
    for module in given.modules:
        found = []
        with (out / f"{module}.jsonl").open("w", encoding="utf-8") as stream:
            for mutant in examine(module, given.count, given.seed, root, out / "last.log"):
                found.append(mutant)
                print(json.dumps(asdict(mutant)), file=stream, flush=True)
                if mutant.survived:
                    print(f"{module}:{mutant.line}: survived: {mutant.words}", flush=True)
        killed = sum(not mutant.survived for mutant in found)
        table.append(f"{module:24}{killed:>5} / {len(found)}")
        print(table[-1], flush=True)
    print("\n".join(["", "killed / mutants", *table]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
