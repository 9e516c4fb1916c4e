"""What a release says of itself in several places, held to one another.

The version stands in Cargo.toml; Python's is made of it. Where a format wants it again
(the crates' dependencies on each other, CITATION.cff, a tag), it is compared here, and so are the
address, the licence, and the Python versions that the classifiers name.
"""

import argparse
import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
CRATES = ["ddmhe-run", "ddmhe-interval", "ddmhe-core"]


def text(name: str) -> str:
    """A file of the repository."""
    return (ROOT / name).read_text(encoding="utf-8")


def found(pattern: str, name: str) -> str:
    """The group of `pattern` in the file, which has it once."""
    hits = set(re.findall(pattern, text(name), re.MULTILINE))
    if len(hits) != 1:
        raise SystemExit(f"{name}: expected one of {pattern}, found {sorted(hits)}")
    return hits.pop()


def disagreements(tag: str | None = None) -> list[str]:
    """What does not agree, in words."""
    wrong = []

    def expect(where: str, wanted: str, got: str) -> None:
        if wanted != got:
            wrong.append(f"{where}: expected {wanted}, found {got}")

    version = found(r'^version = "(.*)"$', "Cargo.toml")
    for crate in CRATES:
        expect(crate, version, found(rf'^{crate} = .*version = "(.*?)"', "Cargo.toml"))
        expect(f"{crate}/LICENSE", text("LICENSE"), text(f"crates/{crate}/LICENSE"))
        if not text(f"crates/{crate}/README.md").startswith(f"# {crate}\n"):
            wrong.append(f"{crate}/README.md: expected a heading with its name")
    expect("CITATION.cff", version, found(r"^version: (.*)$", "CITATION.cff"))
    address = found(r'^repository = "(.*)"$', "Cargo.toml")
    expect("pyproject.toml", address, found(r'^Repository = "(.*)"$', "pyproject.toml"))
    expect("CITATION.cff", address, found(r'^repository-code: "(.*)"$', "CITATION.cff"))
    licence = found(r'^license = "(.*)"$', "Cargo.toml")
    expect("pyproject.toml", licence, found(r'^license = "(.*)"$', "pyproject.toml"))
    oldest = found(r'^requires-python = ">=(.*)"$', "pyproject.toml")
    classifiers = re.findall(r"Python :: (3\.\d+)", text("pyproject.toml"))
    expect("classifiers", oldest, classifiers[0])
    if "## [Unreleased]" not in text("CHANGELOG.md") and f"## [{version}]" not in text(
        "CHANGELOG.md"
    ):
        wrong.append(f"CHANGELOG.md: expected a section of {version} or of what is unreleased")
    if tag is not None:
        expect("the tag", f"v{version}", tag)
        if f"## [{version}]" not in text("CHANGELOG.md"):
            wrong.append(f"CHANGELOG.md: expected a section of {version}")
    return wrong


def main() -> None:
    """Says what does not agree, and ends with 1 then."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tag", help="of a release: v and the version")
    wrong = disagreements(parser.parse_args().tag)
    print("\n".join(wrong) or "version, address, licence and Python versions agree")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
