#!/bin/sh
# Brings .venv and the compiled core up to date; quick when they are. `setup.sh packages` leaves
# out the core, `setup.sh run` the packages that only tests and tools need. What is up to date is
# decided by content, since a time of change says nothing after a checkout or an unpacked archive.
set -eu
cd "$(dirname "$0")/.."

fail() {
    echo "ddmhe: $*" >&2
    exit 1
}

# at_least FOUND WANTED, by major.minor
at_least() {
    awk -v found="$1" -v wanted="$2" 'BEGIN {
        split(found, f, "."); split(wanted, w, ".")
        exit !(f[1] > w[1] || (f[1] == w[1] && f[2] >= w[2]))
    }'
}

version_of() {
    "$1" -c 'import platform; print(platform.python_version())' 2>/dev/null
}

# --- the machine: everything is checked before anything is made

wanted=$(sed -n 's/^requires-python = ">=\(.*\)"/\1/p' pyproject.toml)
if [ -n "${PYTHON:-}" ] || ! version_of .venv/bin/python >/dev/null; then
    python=${PYTHON:-python3}
else
    python=.venv/bin/python
fi
needed="Python >= $wanted is needed (PYTHON=... names another)"
version=$(version_of "$python") || fail "$needed: '$python' not found"
at_least "$version" "$wanted" || fail "$needed: '$python' is $version"
"$python" -c 'import ensurepip, venv' 2>/dev/null ||
    fail "Python's venv and ensurepip are needed: '$python' ($version) has none" \
        "(Debian: apt install python3-venv)"

wanted=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
for tool in cargo rustc; do
    found=$("$tool" --version 2>/dev/null) ||
        fail "Rust >= $wanted is needed: no working '$tool' found"
    found=$(echo "$found" | cut -d' ' -f2)
    at_least "$found" "$wanted" || fail "Rust >= $wanted is needed: $tool is $found"
done
command -v cc >/dev/null ||
    fail "a C compiler is needed as Rust's linker: 'cc' not found (Debian: apt install gcc)"

# --- Python packages

if [ "$(version_of .venv/bin/python)" != "$version" ]; then
    echo "Creating .venv with Python $version"
    rm -rf .venv
    "$python" -m venv .venv
fi

# What has been installed is kept beside it, as it was asked for.
lists="requirements-run.txt requirements-dev.txt"
[ "${1:-}" != run ] || lists=requirements-run.txt
missing=
for list in $lists; do
    cmp -s "$list" ".venv/installed-$list" || missing=${lists##* }
done

install() {
    .venv/bin/python -m pip install --quiet --disable-pip-version-check "$@"
}

install_missing() {
    install -r "$missing"
    for list in $lists; do cp "$list" ".venv/installed-$list"; done
}

if [ -n "$missing" ]; then
    echo "Installing Python packages into .venv"
    .venv/bin/python -m ensurepip >/dev/null # an interrupted .venv has no pip yet
fi
if [ "${1:-}" = packages ]; then
    [ -z "$missing" ] || install_missing
    exit 0
fi

# --- the compiled core: the Python sources are used in place, only Rust has to be built

# Everything that a build reads, and the library that it left in the package; .venv points to this
# folder by its path.
state() {
    pwd
    rustc --version
    find Cargo.toml Cargo.lock pyproject.toml crates tests/rust -type f ! -name '.*' \
        -exec cksum {} +
    find benches -name '*.rs' -exec cksum {} +
    find python/ddmhe -name '_core*.so' -exec cksum {} +
}

# All of it is read before it is compared: find would complain of a comparison that ends early.
found=$(state)
if ! printf '%s\n' "$found" | cmp -s - .venv/built-state; then
    rm -f .venv/built-state
    # Cargo goes by times of change: without this it would keep what it built from a newer file.
    [ ! -d "${CARGO_TARGET_DIR:-target}/release" ] ||
        cargo clean --quiet --release --locked \
            -p ddmhe-run -p ddmhe-interval -p ddmhe-core -p ddmhe-py
    if [ -n "$missing" ]; then
        # Packages come while the core is compiled, for which maturin is enough.
        install "$(grep '^maturin==' requirements-run.txt)"
        install_missing &
        .venv/bin/maturin develop --release --locked --skip-install || { wait; exit 1; }
        wait $!
        missing=
    fi
    # what the package needs is in requirements-run.txt; pip says of each that it is there
    PIP_QUIET=1 .venv/bin/maturin develop --release --locked
    state >.venv/built-state
fi
[ -z "$missing" ] || install_missing
