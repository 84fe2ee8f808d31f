#!/usr/bin/env bash
# Trains and judges seeds of the four systems in both treatments: what the table of research/docs/README.md still lacks.
# The pairs have to be of the rows' corpus: version 2, made at commit 7078547 by `signsplice synth pairs -o DIR`, and
# with --truth word. A training takes 7 to 20 core-minutes. Weights that were not kept are trained again, and their rows
# are then those of the new weights. The same call continues.
#
#   SYSTEMS="lstm lstm-plain" SEEDS=2 PAIRS=out/pairs research/runs/missing_rows.sh [--minutes M]
#   TRUTH=word PAIRS=out/pairs-word research/runs/missing_rows.sh
set -euo pipefail
cd "$(dirname "$0")/../.."

TRUTH=${TRUTH:-partner}
if [ "$TRUTH" = partner ]; then OF='' OUT=research/docs; else OF=-$TRUTH OUT=research/docs/$TRUTH; fi
PAIRS=${PAIRS:-out/pairs$OF}
BUNDLES=${BUNDLES:-out/bundles$OF}
WORKERS=${WORKERS:-$(nproc)}
SEEDS=${SEEDS:-"0 1 2"}
FOUR="lpt-printed-equal lpt-printed lstm lstm-plain transformer transformer-plain conv-s2s conv-s2s-plain"
SYSTEMS=${SYSTEMS:-$FOUR}
run=.venv/bin/signsplice-paper

for seed in $SEEDS; do
    chosen=(--pairs "$PAIRS" --bundles "$BUNDLES" --split random --optimiser adamw --fr 8 --seed "$seed")
    for system in $SYSTEMS; do
        chosen+=(--system "$system")
    done
    $run train "${chosen[@]}" --workers "$WORKERS" "$@"
    $run judge "${chosen[@]}" --out "$OUT"
done
$run tables
