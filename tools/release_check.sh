#!/bin/sh
# All of a release that can be tried on one machine: what release.yml runs, but for the upload.
set -eu
cd "$(dirname "$0")/.."
python=.venv/bin/python
release=.venv-release/bin

echo "== names"
$python tools/release_names.py

echo "== crates: each packed, and built from what was packed"
# no number is computed: not optimised, it is built in half the time
CARGO_PROFILE_DEV_OPT_LEVEL=0 CARGO_PROFILE_DEV_DEBUG=0 \
    cargo publish --workspace --dry-run --locked ${DIRTY:+--allow-dirty}

echo "== licences"
if cargo deny --version >/dev/null 2>&1; then
    cargo deny --locked check licenses bans sources
else
    echo "left out: no cargo-deny (cargo install cargo-deny --locked)"
fi

echo "== source distribution, and a wheel of it"
rm -rf dist
$python -m maturin sdist --out dist
tmp=$(mktemp -d)
trap 'rm -rf "$tmp"' EXIT
# the build's own folder, so that dependencies are not compiled once more
CARGO_TARGET_DIR="$PWD/target" $python -m pip wheel --quiet --disable-pip-version-check \
    --no-deps --wheel-dir "$tmp" dist/*.tar.gz
$release/twine check --strict dist/*.tar.gz "$tmp"/*.whl
$python -m maturin build --release --locked --auditwheel check --out dist

echo "== wheels in empty environments"
$release/auditwheel show dist/*.whl | sed -n '/consistent/,/^$/p'
$python tools/try_wheel.py "$tmp"/*.whl
$python tools/try_wheel.py --core dist/*.whl
