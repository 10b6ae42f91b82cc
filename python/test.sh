#!/usr/bin/env bash
# The Python package, in a virtual environment of its own: build the wheel, install it, test it.
# Python 3.10 or later by PYTHON, else python3. Arguments go to pytest; --check looks for that Python alone.
set -euo pipefail
cd "$(dirname "$0")"

python="${PYTHON:-python3}"
if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2> /dev/null; then
    found="$("$python" --version 2> /dev/null | head -n 1 || true)"
    echo "python/test.sh needs Python 3.10 or later; $python is: ${found:-not there}. PYTHON=... names another." >&2
    exit 1
fi

# Only asked whether there is such a Python.
if [ "${1:-}" = "--check" ]; then exit 0; fi

room="$(mktemp -d)"
trap 'rm -rf "$room"' EXIT
"$python" -m venv "$room/venv"
bin="$room/venv/bin"
"$bin/python" -m pip install --quiet --disable-pip-version-check \
    'maturin>=1.9,<2' numpy distributed matplotlib mypy pytest tqdm uncertainties

# The program that the wheel's numbers are held against.
cargo build --release --locked --manifest-path ../Cargo.toml --bin vibroimpact
"$bin/maturin" build --release --locked --interpreter "$bin/python" --out "$room/wheels"

size="$(wc -c < "$room"/wheels/*.whl)"
echo "the wheel has $size bytes"
if [ "$size" -ge 10000000 ]; then
    echo "the wheel is to have less than 10 MB" >&2
    exit 1
fi
"$bin/python" -m pip install --quiet --disable-pip-version-check --no-deps "$room"/wheels/*.whl

# Outside of the source, so that the wheel is what is tested.
root="$(cd .. && pwd)"
cd "$room"
target="${CARGO_TARGET_DIR:-$root/target}"
VIBROIMPACT_PROGRAM="${VIBROIMPACT_PROGRAM:-$target/release/vibroimpact}" \
    "$bin/python" -m pytest -c "$root/python/pyproject.toml" --rootdir "$root/python" -p no:cacheprovider \
    "$root/python/tests" "$@"
