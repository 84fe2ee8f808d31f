#!/usr/bin/env bash
# The networks that ship, from nothing: signing to learn from, both networks side by side, 8-bit weights put in their place.
# Two hours on two cores. Called again after an interruption, it goes on where it was.
set -euo pipefail
cd "$(dirname "$0")/.."

SIGNING=${SIGNING:-out/signing}
OUT=${OUT:-out/own}
[ -x .venv/bin/signsplice ] || make .venv/.dev
run=.venv/bin/signsplice
export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}

$run synth endless -o "$SIGNING"
$run train cutter --signing "$SIGNING" --out "$OUT/cutter" "$@" &
cutter=$!
trap 'kill -INT $cutter 2>/dev/null || true' EXIT
$run train transition --signing "$SIGNING" --out "$OUT/transition" "$@"
wait $cutter
trap - EXIT
# Both are trained: this puts them into one bundle.
for network in cutter transition; do
    $run train $network --signing "$SIGNING" --out "$OUT/bundle" "$@"
done
rm -rf src/signsplice/splicing/weights
$run export "$OUT/bundle" -o src/signsplice/splicing/weights --int8
