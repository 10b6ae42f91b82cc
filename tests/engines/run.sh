#!/usr/bin/env bash
# The lines of docs/scale.md on one machine: a Slurm array as a loop, submitit's local executor, a HyperQueue server with
# two workers. Each map must come to the same bytes as the one that a single process makes. Needs Python 3.9 or later and
# a package index; a program built before may be named by VIBROIMPACT_PROGRAM.
set -euo pipefail
cd "$(dirname "$0")"
here="$PWD"
root="$(cd ../.. && pwd)"

program="${VIBROIMPACT_PROGRAM:-}"
if [ -z "$program" ]; then
    cargo build --release --locked --manifest-path "$root/Cargo.toml" --bin vibroimpact
    program="${CARGO_TARGET_DIR:-$root/target}/release/vibroimpact"
fi

room="$(mktemp -d)"
trap 'rm -rf "$room"' EXIT
mkdir "$room/bin"
ln -s "$(realpath "$program")" "$room/bin/vibroimpact"
export PATH="$room/bin:$PATH"

"${PYTHON:-python3}" -m venv "$room/venv"
"$room/venv/bin/python" -m pip install --quiet --disable-pip-version-check hyperqueue submitit

fresh() { mkdir "$room/$1"; cp "$here/scene.toml" "$room/$1"; cd "$room/$1"; }

fresh whole
over=$(grep -o -- '--over [^ ]*' "$here/map.sbatch" | tr '\n' ' ')
# shellcheck disable=SC2086 # words are meant
vibroimpact map scene.toml $over --out map --quiet
vibroimpact collect map

check() {
    vibroimpact collect map
    for file in map.csv map.npz map.svg report.html; do
        cmp "map/$file" "../whole/map/$file"
    done
    test "$(ls map/part-*-of-7.jsonl | wc -l)" -eq 7
    echo "$1: 7 parts, the same bytes as the whole"
}

# A Slurm array: the script as the scheduler runs it, once a task. Task 3 is killed and requeued.
fresh slurm
for SLURM_ARRAY_TASK_ID in 1 2 3 4 5 6 7; do
    export SLURM_ARRAY_TASK_ID SLURM_CPUS_PER_TASK=2
    if [ "$SLURM_ARRAY_TASK_ID" -eq 3 ]; then
        timeout --signal=KILL 0.03 bash "$here/map.sbatch" || echo "task 3 was killed: $?"
    fi
    bash "$here/map.sbatch"
done
check "Slurm array"

fresh submitit
"$room/venv/bin/python" "$here/submitit_map.py" local
check "submitit"

fresh hyperqueue
"$room/venv/bin/python" "$here/hyperqueue_map.py"
check "HyperQueue"
