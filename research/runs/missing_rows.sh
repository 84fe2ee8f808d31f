#!/usr/bin/env bash
# The rows that the comparison of like with like still lacks (research/docs/README.md): the three rivals as printed,
# LpTransformer in equal treatment, and LpTransformer with the bias alone, with three seeds on both truths. The pairs have
# to be of the rows' corpus: version 2, made at commit 7078547 by `signsplice synth pairs -o DIR`, and with --truth word.
# Five trainings a seed and truth, about 25 minutes of one core each. The same call continues.
# LpTransformer is trained again where its weights were not kept, and its rows are then those of the new weights.
#
#   PAIRS=out/pairs research/runs/missing_rows.sh [--minutes M]
#   TRUTH=word PAIRS=out/pairs-word research/runs/missing_rows.sh
set -euo pipefail
cd "$(dirname "$0")/../.."

TRUTH=${TRUTH:-partner}
if [ "$TRUTH" = partner ]; then OF='' OUT=research/docs; else OF=-$TRUTH OUT=research/docs/$TRUTH; fi
PAIRS=${PAIRS:-out/pairs$OF}
BUNDLES=${BUNDLES:-out/bundles$OF}
WORKERS=${WORKERS:-$(nproc)}
SEEDS=${SEEDS:-"0 1 2"}
run=.venv/bin/signsplice-paper

for seed in $SEEDS; do
    chosen=(--pairs "$PAIRS" --bundles "$BUNDLES" --split random --optimiser adamw --fr 8 --seed "$seed")
    for system in lpt-printed-equal lpt-printed lstm-plain transformer-plain conv-s2s-plain; do
        chosen+=(--system "$system")
    done
    $run train "${chosen[@]}" --workers "$WORKERS" "$@"
    $run judge "${chosen[@]}" --out "$OUT"
done
$run tables
