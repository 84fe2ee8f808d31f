/** Linear equations whose matrix is symmetric, positive definite and banded. */

/** The lower half of such a matrix of n rows: element (i, j), i - width <= j <= i, is at i (width + 1) + j - i + width. */
export class Band {
  readonly values: Float64Array;

  constructor(readonly rows: number, readonly width: number) {
    this.values = new Float64Array(rows * (width + 1));
  }

  add(row: number, column: number, value: number): void {
    this.values[row * (this.width + 1) + column - row + this.width]! += value;
  }

  /**
   * Solve for right sides (rows, sides), in place, by Cholesky's method; the matrix becomes its factor. Yields now and then, for
   * others to get their turn.
   */
  *solve(right: Float64Array, sides: number): Generator<void, Float64Array> {
    const { rows, width, values } = this;
    const wide = width + 1;
    for (let i = 0; i < rows; i++) {
      if (i % 512 === 511) yield;
      const row = i * wide + width - i; // + j: element (i, j)
      const first = Math.max(0, i - width);
      for (let j = first; j <= i; j++) {
        const other = j * wide + width - j;
        let sum = values[row + j]!;
        for (let k = Math.max(first, j - width); k < j; k++) sum -= values[row + k]! * values[other + k]!;
        values[row + j] = i === j ? Math.sqrt(sum) : sum / values[other + j]!;
      }
      for (let side = 0; side < sides; side++) {
        let sum = right[i * sides + side]!;
        for (let k = first; k < i; k++) sum -= values[row + k]! * right[k * sides + side]!;
        right[i * sides + side] = sum / values[row + i]!;
      }
    }
    for (let i = rows - 1; i >= 0; i--) {
      for (let side = 0; side < sides; side++) {
        const value = (right[i * sides + side]! /= values[i * wide + width]!);
        for (let k = Math.max(0, i - width); k < i; k++) right[k * sides + side]! -= values[i * wide + width + k - i]! * value;
      }
    }
    return right;
  }
}

/** Visit the elements (row, column <= row) of D'D that are not 0, D the second differences of n values. */
export function secondDifferences(n: number, visit: (row: number, column: number, value: number) => void): void {
  const weights = [1, -2, 1];
  for (let t = 0; t + 2 < n; t++) {
    for (let a = 0; a < 3; a++) for (let b = 0; b <= a; b++) visit(t + a, t + b, weights[a]! * weights[b]!);
  }
}
