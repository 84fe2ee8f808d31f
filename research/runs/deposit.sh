#!/bin/sh
# Pack what a deposit of the figures needs into one archive of under 200 MB: the corpus to judge on, trained systems,
# results and the report. PAIRS: the corpus; it is made where it is missing.
set -eu
pairs=${PAIRS:-out/judged}
out=${OUT:-out/signsplice-lptransformer.tar.gz}
[ -f "$pairs/corpus.json" ] || signsplice synth pairs --truth events -o "$pairs"
mkdir -p "$(dirname "$out")"
signsplice-paper report
tar -czf "$out" "$pairs" research/bundles research/docs research/benchmark CITATION.cff LICENSE
ls -l "$out"
