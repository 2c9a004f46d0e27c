#!/bin/bash -eu
# Called by ClusterFuzzLite in its image: every fuzz target and its seeds to $OUT.
cargo fuzz build -O --debug-assertions --target-dir "$WORK/fuzz"
for file in fuzz/fuzz_targets/*.rs; do
  target=$(basename "$file" .rs)
  cp "$WORK/fuzz/x86_64-unknown-linux-gnu/release/$target" "$OUT/"
  zip -jqr "$OUT/${target}_seed_corpus.zip" "fuzz/corpus/$target"
done
