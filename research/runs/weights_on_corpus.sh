#!/usr/bin/env bash
# Trains this project's networks further on the training part of a split of the corpus of pairs, as every system of the
# paper is trained, so that `signsplice-paper evaluate` can compare them. Half of the data is other synthetic signing,
# so that the networks do not forget it. Needs what `make weights` and research/runs/paper.sh made. About two hours on two
# cores. The same call continues after an interruption. Arguments go to every `signsplice train`.
set -euo pipefail
cd "$(dirname "$0")/../.."

PAIRS=${PAIRS:-out/pairs}
SIGNING=${SIGNING:-out/weights/signing}
WORDS=${WORDS:-out/weights/signing}
WEIGHTS=${WEIGHTS:-out/weights}
OUT=${OUT:-out/weights-on-corpus}
BUNDLES=${BUNDLES:-out/bundles}
run=.venv/bin/signsplice
export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}

newest() { ls -dt "$WEIGHTS"/parts/"$1"-*/ | head -n 1; }
CUTTER=${CUTTER:-$(newest cutter)}
TRANSITION=${TRANSITION:-$(newest transition)}

for split in random unseen-words; do
    into=$OUT/bundles/$split
    $run synth signing "$PAIRS" --split "$split" -o "$OUT/$split"
    cutter=(train cutter --scale corpus --signing "$OUT/$split" --signing "$WORDS" --from "$CUTTER" "$@")
    transition=(train transition --scale corpus --signing "$OUT/$split" --signing "$SIGNING" --from "$TRANSITION" "$@")
    $run "${cutter[@]}" --out "$into/cutter" &
    other=$!
    trap 'kill -TERM $other 2>/dev/null || true' EXIT
    $run "${transition[@]}" --out "$into/transition"
    wait $other
    trap - EXIT
    # Both are trained now; these calls find them trained and put them into one bundle, beside the paper's systems.
    $run "${cutter[@]}" --out "$into/bundle"
    $run "${transition[@]}" --out "$into/bundle"
    mkdir -p "$BUNDLES"
    rm -rf "$BUNDLES/own-$split"
    cp -r "$into/bundle" "$BUNDLES/own-$split"
done
