"""What shapes towns, traffic, drives and samples calls nothing that rounds differently on another processor.

NumPy, BLAS and C libraries choose code by the processor; `core/elementary.py` has the same functions for all.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import carlaloc_env

ROOT = Path(carlaloc_env.__file__).parents[1]
SHAPES = ("carlaloc_env", "recorder/devices/scripted", "recorder/drive")
"""Folders whose numbers end in a drive or a sample."""
ELSEWHERE = ("render", "envs", "authoring", "openstreetmap")
"""Rooms of `carlaloc_env` for pictures, for observations and rewards of learning, and for writing maps, whose
numbers are rounded."""
EXEMPT = {
    "core/camera_model.py": "a lens is chosen once; calibrations hold its focal length",
    "rigs/industrial_camera.py": "an industrial camera's pictures are not the same on other processors",
    "road/rough_surface.py": "what comes out of the Fourier transform is rounded to a grid",
    "sensors/imaging/imager.py": "pictures are not the same on other processors",
    "sensors/camera_config.py": "pictures are not the same on other processors",
    "scenery/ground/height_fields.py": "what comes out of the equations is rounded to a grid",
}
"""Where such a function decides no bytes, and why."""
TRIGONOMETRY = "sin cos tan asin acos atan atan2 arcsin arccos arctan arctan2 sinh cosh tanh arcsinh sinc"
POWERS = "exp exp2 expm1 log log2 log10 log1p pow power float_power cbrt geomspace"
PRODUCTS = "dot vdot inner matmul tensordot einsum convolve correlate polyfit"
SOLVERS = "leggauss laggauss hermgauss chebgauss roots lstsq eigvals eigh"
REFUSED = frozenset(f"{TRIGONOMETRY} {POWERS} {PRODUCTS} {SOLVERS}".split())
LIBRARIES = ("numpy.linalg", "numpy.fft", "scipy.linalg", "scipy.sparse.linalg", "scipy.fft", "scipy.special")


def faults(tree: ast.AST, compiled: bool = False) -> Iterator[tuple[int, str]]:
    """Lines that break the rule, and how; compiled functions multiply for a whole power."""
    for node in ast.iter_child_nodes(tree):
        inside = compiled
        if isinstance(node, ast.FunctionDef):
            inside = compiled or any(ast.unparse(one) == "compiled" for one in node.decorator_list)
        text = _fault(node, inside)
        if text is not None:
            yield node.lineno, text  # type: ignore[attr-defined]
        yield from faults(node, inside)


def _fault(node: ast.AST, compiled: bool) -> str | None:
    match node:
        case ast.BinOp(op=ast.MatMult()) | ast.AugAssign(op=ast.MatMult()):
            return "@"
        case ast.BinOp(left=base, op=ast.Pow(), right=exponent):
            exact = isinstance(base, ast.Constant) and base.value in (2.0, 4.0, 10)
            whole = isinstance(exponent, ast.Constant) and isinstance(exponent.value, int)
            squared = whole and exponent.value == 2  # type: ignore[attr-defined]
            return (
                None
                if squared or (exact and "/" not in ast.unparse(exponent)) or (whole and compiled)
                else "**"
            )
        case ast.Attribute(value=ast.Name(id="np" | "math"), attr=name) if name in REFUSED:
            return ast.unparse(node)
        case ast.Attribute(value=ast.Attribute(), attr=name) if name in SOLVERS.split():
            return ast.unparse(node)
        case ast.Attribute(attr="dot"):
            return ".dot"
        case ast.Attribute(value=ast.Attribute(value=ast.Name(id="np"), attr="linalg" | "fft"), attr=name):
            return None if name == "norm" else ast.unparse(node)
        case ast.Call(func=ast.Attribute(attr="norm"), args=args, keywords=keywords):
            # Without an axis it is a product of BLAS.
            return None if len(args) > 1 or any(k.arg == "axis" for k in keywords) else "norm without axis"
        case ast.ImportFrom(module=str(module), names=names):
            wrong = [one.name for one in names if one.name in REFUSED and module in ("math", "numpy")]
            # SciPy takes a Gaussian's weights from `np.exp`.
            wrong += [one.name for one in names if module == "scipy.ndimage" and "gaussian" in one.name]
            return f"{module}.{wrong[0]}" if wrong else module if module.startswith(LIBRARIES) else None
    return None


def test_nothing_rounds_by_the_processor() -> None:
    found, read = [], 0
    for file in (file for place in SHAPES for file in sorted((ROOT / place).rglob("*.py"))):
        name = file.relative_to(ROOT).as_posix().removeprefix("carlaloc_env/")
        if name not in EXEMPT and name.partition("/")[0] not in ELSEWHERE:
            read += 1
            found += [f"{name}:{line}: {what}" for line, what in faults(ast.parse(file.read_text()))]
    assert read > 200
    assert not found, "\n".join([*found, "call core/elementary.py or core/elementary_kernels.py instead"])


@pytest.mark.parametrize(
    "code",
    [
        *("a @ b", "a @= b", "np.sin(x)", "math.atan2(y, x)", "from math import exp", "a.dot(b)", "x ** 0.5"),
        *(
            "np.einsum('ij,j', a, b)",
            "np.linalg.solve(a, b)",
            "np.linalg.norm(x)",
            "u ** 3",
            "10 ** (x / 20)",
            "np.polynomial.legendre.leggauss(10)",
        ),
        "from scipy.sparse.linalg import spsolve",
        "from scipy.ndimage import gaussian_filter",
    ],
)
def test_each_way_to_break_the_rule_is_seen(code: str) -> None:
    assert list(faults(ast.parse(code)))
