/** Points of space in a balanced tree, for those near a place. */

const BUCKET = 8; // so few points are looked at one by one

export class KdTree {
  /** Numbers of points: the middle of each range of more than ``BUCKET`` splits it at right angles to one axis, x y z in turn. */
  private readonly order: Uint32Array;
  private readonly place = new Float64Array(3);
  /** Squared distance of what ``nearest`` found last. */
  squared = 0;
  private found = -1;

  /** ``points``: x y z each. */
  constructor(readonly points: Float64Array) {
    this.order = Uint32Array.from({ length: points.length / 3 }, (_, k) => k);
    this.split(0, this.order.length, 0);
  }

  /** Number of the nearest point within a distance of a place; -1 where there is none. */
  nearest(x: number, y: number, z: number, most: number): number {
    this.squared = most * most;
    this.found = -1;
    this.place[0] = x;
    this.place[1] = y;
    this.place[2] = z;
    this.search(0, this.order.length, 0);
    return this.found;
  }

  /** Visit the points within a distance of a place. */
  within(place: Float64Array, most: number, visit: (point: number, squared: number) => void, from = 0, to = this.order.length, axis = 0): void {
    const middle = (from + to) >> 1;
    const isLeaf = to - from <= BUCKET;
    for (let k = isLeaf ? from : middle; k < (isLeaf ? to : middle + 1); k++) {
      const point = this.order[k]!;
      const squared = this.squaredTo(point, place);
      if (squared < most * most) visit(point, squared);
    }
    if (isLeaf) return;
    const beyond = place[axis]! - this.points[3 * this.order[middle]! + axis]!;
    if (beyond < most) this.within(place, most, visit, from, middle, (axis + 1) % 3);
    if (beyond > -most) this.within(place, most, visit, middle + 1, to, (axis + 1) % 3);
  }

  private search(from: number, to: number, axis: number): void {
    const middle = (from + to) >> 1;
    const isLeaf = to - from <= BUCKET;
    for (let k = isLeaf ? from : middle; k < (isLeaf ? to : middle + 1); k++) {
      const squared = this.squaredTo(this.order[k]!, this.place);
      if (squared >= this.squared) continue;
      this.squared = squared;
      this.found = this.order[k]!;
    }
    if (isLeaf) return;
    const beyond = this.place[axis]! - this.points[3 * this.order[middle]! + axis]!;
    const next = (axis + 1) % 3;
    if (beyond < 0) this.search(from, middle, next);
    else this.search(middle + 1, to, next);
    if (beyond * beyond >= this.squared) return;
    if (beyond < 0) this.search(middle + 1, to, next);
    else this.search(from, middle, next);
  }

  private squaredTo(point: number, place: Float64Array): number {
    const x = this.points[3 * point]! - place[0]!;
    const y = this.points[3 * point + 1]! - place[1]!;
    const z = this.points[3 * point + 2]! - place[2]!;
    return x * x + y * y + z * z;
  }

  /** Order a range so that its middle splits it, and both halves likewise (Hoare's selection). */
  private split(from: number, to: number, axis: number): void {
    if (to - from <= BUCKET) return;
    const { order, points } = this;
    const at = (k: number) => points[3 * order[k]! + axis]!;
    const middle = (from + to) >> 1;
    for (let low = from, high = to - 1; low < high; ) {
      const pivot = at(middle);
      let [i, j] = [low, high];
      while (i <= j) {
        while (at(i) < pivot) i++;
        while (at(j) > pivot) j--;
        if (i > j) break;
        [order[i], order[j]] = [order[j]!, order[i]!];
        i++;
        j--;
      }
      if (j < middle) low = i;
      if (i > middle) high = j;
    }
    this.split(from, middle, (axis + 1) % 3);
    this.split(middle + 1, to, (axis + 1) % 3);
  }
}
