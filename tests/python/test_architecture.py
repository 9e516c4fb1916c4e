"""Imports point one way: no circle between files, in Python or in Rust, nor between crates."""

import ast
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CRATES = sorted(path.parent.parent for path in ROOT.glob("crates/*/src/lib.rs"))


def circle(imports):
    """A circle in a mapping from file to the files that it imports, or None."""
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        return error.args[1]
    return None


def python_imports():
    """Modules of the package by the modules that they import, anywhere in the file; `ddmhe` itself
    only lists names."""
    paths = {}
    for path in (ROOT / "python" / "ddmhe").rglob("*.py"):
        parts = path.relative_to(ROOT / "python").with_suffix("").parts
        paths[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    found = {}
    for module, path in paths.items():
        named = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                named |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path}: imports are written in full"
                inner = [f"{node.module}.{alias.name}" for alias in node.names]
                named |= {name if name in paths else str(node.module) for name in inner}
        # importing a package's inside from within it is no circle with the package's own list of
        # names
        found[module] = {name for name in named & set(paths) if name not in ("ddmhe", module)}
    return found


def imported_at_once(module):
    """Whole libraries that a module of the package loads when it is imported."""
    path = ROOT / "python" / Path(*module.split("."))
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    found = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(str(node.module).partition(".")[0])
    return found


def rust_imports(crate):
    """Files of a crate by the files that they import, tests and links in comments left out."""
    src = crate / "src"
    files = {}
    for path in src.rglob("*.rs"):
        parts = path.relative_to(src).with_suffix("").parts
        if parts != ("lib",):
            files["::".join(parts)] = path

    def file_of(path):
        while path and path not in files:
            path = path.rpartition("::")[0]
        return path

    found = {}
    for name, path in files.items():
        text = re.sub(r"#\[cfg\(test\)\].*", "", path.read_text(), flags=re.DOTALL)
        code = "\n".join(line for line in text.splitlines() if not line.lstrip().startswith("//"))
        parent = name.rpartition("::")[0]
        # super:: is the parent; a file also imports the files that it declares
        code = re.sub(r"\bsuper::", f"crate::{parent}::" if parent else "crate::", code)
        paths = re.findall(r"\bcrate::((?:\w+::)*\w+)", code)
        paths += [f"{name}::{child}" for child in re.findall(r"^(?:pub )?mod (\w+);", code, re.M)]
        paths += [
            part.strip()
            for group in re.findall(r"\bcrate::\{([^}]*)\}", code)
            for part in group.split(",")
        ]
        found[name] = {file_of(p) for p in paths} - {"", name}
    return found


def crate_imports():
    """Crates of the workspace by those that they depend on, tests apart."""
    found = {}
    for crate in CRATES:
        text = (crate / "Cargo.toml").read_text()
        needed = re.search(r"^\[dependencies\]\n((?!\[).*\n)*", text, re.M)[0]
        found[crate.name] = set(re.findall(r"^(ddmhe-\w+)", needed, re.M))
    return found


def test_python_imports_have_no_circle():
    found = python_imports()
    assert len(found) > 30
    assert circle(found) is None


@pytest.mark.parametrize(
    ("library", "places"),
    [
        ("cvxpy", ()),
        ("matplotlib", ("ddmhe.report.style", "ddmhe.report.figures.", "ddmhe.reproduce.figures")),
    ],
)
def test_slow_libraries_are_loaded_where_they_are_used(library, places):
    """cvxpy inside of functions, matplotlib by the modules of figures, and these by nobody else at
    once."""
    found = python_imports()
    at_once = {module for module in found if library in imported_at_once(module)}
    assert {module for module in at_once if not module.startswith(places or "-")} == set()
    assert bool(at_once) == bool(places)


@pytest.mark.parametrize("crate", CRATES, ids=lambda crate: crate.name)
def test_rust_imports_have_no_circle(crate):
    found = rust_imports(crate)
    assert any(found.values())
    assert circle(found) is None


def test_crates_depend_one_way():
    found = crate_imports()
    assert circle(found) is None
    assert found["ddmhe-interval"] == set()
    assert found["ddmhe-core"] >= {"ddmhe-interval"}
    assert not any("ddmhe-py" in needed for needed in found.values())


def test_files_are_short_and_narrow():
    """At most 450 lines, of 100 characters in Rust, where rustfmt leaves comments as they are; of
    Python ruff sees to it."""
    folders = ("benches", "crates", "examples", "python", "studies", "tests")
    found = [
        f"{path.relative_to(ROOT)}:{k}"
        for path in (p for f in folders for s in ("*.rs", "*.py") for p in (ROOT / f).rglob(s))
        for k, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if (k > 450 or (path.suffix == ".rs" and len(line) > 100)) and "target" not in path.parts
    ]
    assert not found


def test_a_circle_is_found():
    assert circle({"a": {"b"}, "b": {"c"}, "c": set()}) is None
    assert set(circle({"a": {"b"}, "b": {"c"}, "c": {"a"}})) == {"a", "b", "c"}
