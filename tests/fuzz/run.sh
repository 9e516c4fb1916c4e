#!/bin/sh
# run.sh SECONDS [TARGET…]: gives each fuzz target (history, snapshot, plan; log, in Python) so many
# seconds, one after the other, and says how often it was run. What breaks is left in
# target/fuzz-found, and the corpus with what was learnt in target/fuzz-corpus.
set -eu
cd "$(dirname "$0")/../.."
seconds=$1
shift
[ $# -gt 0 ] || set -- history snapshot plan log

root=$PWD
(cd tests/fuzz && RUSTC_WRAPPER="$root/tests/fuzz/marked.sh" \
    cargo build --release --locked --target-dir "$root/target/fuzz")
for target; do
    case $target in
    history) longest=600 ;;
    *) longest=8192 ;;
    esac
    learnt=target/fuzz-corpus/$target
    mkdir -p "$learnt" target/fuzz-found
    if [ "$target" = log ] && ! .venv/bin/python -c 'import atheris' 2>/dev/null; then
        echo "fuzz: log: left out, no atheris for this Python" >&2
        continue
    elif [ "$target" = log ]; then
        set -- .venv/bin/python tests/fuzz/log.py
    else
        set -- "target/fuzz/release/$target"
    fi
    said=target/fuzz-found/$target.txt
    "$@" "$learnt" "tests/fuzz/corpus/$target" -max_total_time="$seconds" -timeout=60 \
        -max_len=$longest -len_control=0 -artifact_prefix="target/fuzz-found/$target-" \
        -print_final_stats=1 >"$said" 2>&1 || {
        grep -v '^#' "$said" | tail -n 40 >&2
        echo "fuzz: $target broke; see target/fuzz-found" >&2
        exit 1
    }
    echo "fuzz: $target: $(sed -n 's/^Done \(.*\)/\1/p' "$said"), nothing broke"
done
