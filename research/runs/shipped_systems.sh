#!/bin/sh
# Make LpTransformer and LPT+ as they ship, from nothing: two hours of two cores. Checkpoints lie in OUT; the same call
# continues.
set -eu
out=${OUT:-out/shipped}
ship=src/signsplice/splicing/weights
signsplice synth pairs --truth events --teach 44 --own-manner -o "$out/own"
train() {
  OMP_NUM_THREADS=1 signsplice-paper train-system --pairs "$out/own" --split many --out "$out/$1" --parts "$out/parts" --system "$@"
}
train lpt-plus --steps 5000
train lptransformer
signsplice-paper publish "$out/lpt-plus" "$out/lptransformer" -o "$out/published"
cp -r "$out/published/lpt-plus" "$out/published/lptransformer" "$ship/"
python research/runs/shipped_words.py 500
