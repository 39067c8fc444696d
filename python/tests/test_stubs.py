"""The type stubs and the docstrings against the module."""

import ast
import inspect
from pathlib import Path

import pytest

import fuyu
from fuyu import _fuyu

STUBS = ast.parse((Path(fuyu.__file__).parent / "_fuyu.pyi").read_text())


def parameters(function: ast.FunctionDef) -> list[str]:
    args = function.args
    return [a.arg for a in [*args.posonlyargs, *args.args, *args.kwonlyargs, *filter(None, [args.kwarg])]]


def described():
    """Names of functions and methods with their parameters, from the stubs."""
    for node in STUBS.body:
        if isinstance(node, ast.FunctionDef):
            yield node.name, parameters(node)
        elif isinstance(node, ast.ClassDef):
            for item in node.body:
                if isinstance(item, ast.FunctionDef):
                    yield f"{node.name}.{item.name}", parameters(item)
                elif isinstance(item, ast.AnnAssign):
                    yield f"{node.name}.{item.target.id}", []


def find(name):
    found = _fuyu
    for part in name.split("."):
        found = inspect.getattr_static(found, part)
    return found


def test_the_stubs_describe_everything():
    names = {name.split(".")[0] for name, _ in described()} | {"InputError", "RunError", "__version__"}
    assert names == {name for name in vars(_fuyu) if not name.startswith("__") or name == "__version__"} - {"_fuyu"}
    known = {name for name, _ in described()}
    for kind in [fuyu.Model, fuyu.State, fuyu.Integrator, fuyu.Batch, fuyu.Latches, fuyu.Controller, fuyu.Scenario, fuyu.MotionEstimate]:
        public = {f"{kind.__name__}.{name}" for name in vars(kind) if not name.startswith("_")}
        assert public <= known


@pytest.mark.parametrize("name, given", [(n, p) for n, p in described() if not n.split(".")[-1].startswith("__")])
def test_the_stubs_have_the_parameters_of_the_module(name, given):
    found = find(name)
    if isinstance(found, staticmethod):
        found = found.__func__
    if callable(found):
        assert list(inspect.signature(found).parameters) == given
    text = inspect.getdoc(found)
    assert text and text[0].isupper(), f"{name} has no docstring"


def test_the_version_is_that_of_the_package():
    import importlib.metadata

    try:
        installed = importlib.metadata.version("fuyu")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("fuyu is not installed")
    assert installed == fuyu.__version__
