#!/usr/bin/env bash
# The networks that ship, from nothing: sentences for the one that makes transitions, many more words for the one that
# cuts, both networks side by side, 8-bit weights put in their place. Two to three hours on two cores. Called again
# after an interruption, it goes on where it was.
set -euo pipefail
cd "$(dirname "$0")/.."

SIGNING=${SIGNING:-out/signing}
WORDS=${WORDS:-out/words-more}
OUT=${OUT:-out/own}
[ -x .venv/bin/signsplice ] || make .venv/.dev
run=.venv/bin/signsplice
export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}

$run synth endless -o "$SIGNING"
$run synth endless --seed 1 --signers 44 --words 250 --seams 0 -o "$WORDS"
$run train cutter --signing "$WORDS" --out "$OUT/cutter" "$@" &
cutter=$!
trap 'kill -TERM $cutter 2>/dev/null || true' EXIT
$run train transition --signing "$SIGNING" --out "$OUT/transition" "$@"
wait $cutter
trap - EXIT
# Both are trained: this puts them into one bundle.
$run train cutter --signing "$WORDS" --out "$OUT/bundle" "$@"
$run train transition --signing "$SIGNING" --out "$OUT/bundle" "$@"
rm -rf src/signsplice/splicing/weights
$run export "$OUT/bundle" -o src/signsplice/splicing/weights --int8
