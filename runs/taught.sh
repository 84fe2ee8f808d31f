#!/usr/bin/env bash
# This project's networks after the paper's protocol: gone on with on a split's training part, as every system of the
# paper learns from it, beside signing of others, so that they do not forget it. Wants what runs/weights.sh made, and
# the corpus of runs/paper.sh; about two hours on two cores. Called again after an interruption, it goes on where it
# was. `signsplice paper evaluate` judges what comes out.
set -euo pipefail
cd "$(dirname "$0")/.."

PAIRS=${PAIRS:-out/pairs}
SIGNING=${SIGNING:-out/signing}
WORDS=${WORDS:-out/words-more}
OWN=${OWN:-out/own}
OUT=${OUT:-out/taught}
BUNDLES=${BUNDLES:-out/bundles}
run=.venv/bin/signsplice
export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}

newest() { ls -dt "$OWN"/parts/"$1"-*/ | head -n 1; }
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
    # Both have learned: this puts them into one bundle, beside those of the paper's systems.
    $run "${cutter[@]}" --out "$into/bundle"
    $run "${transition[@]}" --out "$into/bundle"
    mkdir -p "$BUNDLES"
    rm -rf "$BUNDLES/own-$split"
    cp -r "$into/bundle" "$BUNDLES/own-$split"
done
