#!/bin/sh
# Cargo's RUSTC_WRAPPER: our own crates get the marks that libFuzzer follows, by options of the
# stable compiler. Others' code has none: no time is lost in it, and it is compiled once.
pass=-Cllvm-args=-sanitizer-coverage
case ${CARGO_PKG_NAME:-} in
ddmhe-*)
    exec "$@" -Cpasses=sancov-module "$pass-level=4" "$pass-inline-8bit-counters" \
        "$pass-pc-table" "$pass-trace-compares"
    ;;
esac
exec "$@"
