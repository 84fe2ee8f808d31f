/** The body around an avatar's bones in the usual human proportions, as the Python module body/capsules makes it. */

import { Vector3 } from 'three';
import type { FitCapsule } from '../wire.js';
import { type Bone, median, restPositions, SIDES } from './body.js';
import { capsules as USUAL, proportions } from './constants.js';

const REGIONS: Record<string, FitCapsule['region']> = { face: 'head', nose: 'head', hair: 'head', sleeve: 'upperArm', cuff: 'lowerArm' };

/** Capsules of head, trunk, arms and hands in the usual proportions. */
export function usualCapsules(bones: Bone[]): FitCapsule[] {
  return new Usual(bones).capsules;
}

class Usual {
  readonly capsules: FitCapsule[] = [];
  private readonly joints: Map<string, Vector3>;
  private readonly height: number;

  constructor(bones: Bone[]) {
    const rest = restPositions(bones);
    this.joints = new Map(bones.map(({ name }, k) => [name, rest[k]!]));
    this.height = this.stature();
    this.addHead();
    this.addTrunk();
    for (const side of SIDES) {
      this.addArm(side);
      this.addHand(side);
    }
  }

  /** Body height from the lengths of arms and legs. */
  private stature(): number {
    const { ARMS, LEGS, ARM_FRACTION, LEG_FRACTION } = proportions;
    const chains = [...ARMS.map((chain) => [chain, ARM_FRACTION] as const), ...LEGS.map((chain) => [chain, LEG_FRACTION] as const)];
    const heights = chains.flatMap(([[a, b, c], fraction]) => {
      const [from, middle, to] = [a, b, c].map((name) => this.joints.get(name));
      return from && middle && to ? [(from.distanceTo(middle) + middle.distanceTo(to)) / fraction] : [];
    });
    return median(heights);
  }

  /** Add a capsule with ends relative to its bone's joint; ``radii`` are fractions of stature. */
  private add(
    key: string, bone: string, region: FitCapsule['region'], start: Vector3, end: Vector3, radii: readonly number[],
    side: FitCapsule['side'] = '',
  ): void {
    const [r0, r1] = radii.map((radius) => radius * this.height) as [number, number];
    this.capsules.push({ key, bone, region, side, start: start.toArray(), end: end.toArray(), radii: [r0, r1] });
  }

  /** A point that is left, up and forward by fractions of stature. */
  private point(left: number, up: number, forward = 0): Vector3 {
    return this.scaled([left, up, forward]);
  }

  private scaled(point: readonly number[]): Vector3 {
    return new Vector3().fromArray(point).multiplyScalar(this.height);
  }

  /** From one joint to another in the T-pose. */
  private bone(from: string, to: string): Vector3 {
    return this.joints.get(to)!.clone().sub(this.joints.get(from)!);
  }

  private addHead(): void {
    USUAL.HEAD.forEach(([part, start, end, r0, r1], n) => {
      const region = REGIONS[part];
      if (region) this.add(`head${n}`, 'head', region, this.scaled(start), this.scaled(end), [r0, r1]);
    });
    if (!this.joints.has('neck')) return;
    this.add('neck', 'neck', 'head', this.point(0, -0.02), this.bone('neck', 'head').add(this.point(0, 0.02)), [0.03, 0.029]);
  }

  private addTrunk(): void {
    const has = (name: string) => this.joints.has(name);
    const chest = ['upperChest', 'chest', 'spine', 'hips'].find(has)!;
    const low = ['spine', 'chest', 'hips'].find(has)!;
    for (const side of SIDES) {
      const collar = has(`${side}Shoulder`) ? `${side}Shoulder` : chest;
      const bone = this.bone(collar, `${side}UpperArm`);
      const ends = [bone.clone().multiplyScalar(0.2), bone.clone().multiplyScalar(0.93)] as const;
      this.add(`${side}Shoulder`, collar, 'trunk', ...ends, [0.035, 0.0325]);
    }
    const girdle = SIDES.map((side) => this.bone(chest, `${side}UpperArm`));
    const middle = girdle[0]!.clone().add(girdle[1]!).divideScalar(2);
    const waist = this.bone(chest, low);
    USUAL.COLUMNS.forEach(([x, r], n) => {
      const start = middle.clone().add(this.point(x, -0.045));
      this.add(`chest${n}`, chest, 'trunk', start, waist.clone().add(this.point(0.94 * x, 0)), [r, 0.92 * r]);
    });
    if (has('neck')) {
      const nape = this.bone(chest, 'neck');
      this.add('back', chest, 'trunk', nape.clone().add(this.point(0, -0.02)), waist, [0.044, 0.05]);
      girdle.forEach((shoulder, n) => {
        const end = shoulder.clone().multiplyScalar(0.55).addScaledVector(middle, 0.45).add(this.point(0, -0.004));
        this.add(`collar${n}`, chest, 'trunk', nape, end, [0.034, 0.033]);
      });
    }
    const hem = this.point(0, -0.035);
    USUAL.COLUMNS.forEach(([x, r], n) => {
      const start = this.bone('hips', low).add(this.point(0.94 * x, 0));
      this.add(`belly${n}`, 'hips', 'trunk', start, this.point(1.08 * x, -0.035), [0.92 * r, 0.057]);
    });
    if (!has('leftUpperLeg') || !has('rightUpperLeg')) return;
    const [left, right] = SIDES.map((side) => this.bone('hips', `${side}UpperLeg`).multiplyScalar(0.95).add(hem));
    this.add('hips', 'hips', 'trunk', left!, right!, [0.057, 0.057]);
  }

  private addArm(side: 'left' | 'right'): void {
    for (const [from, to, r0, r1, part] of USUAL.LIMBS) {
      const region = REGIONS[part];
      if (region) this.add(side + from, side + from, region, new Vector3(), this.bone(side + from, side + to), [r0, r1], side);
    }
  }

  /** The palm as capsules from the wrist to each knuckle, and every phalanx. */
  private addHand(side: 'left' | 'right'): void {
    const wrist = `${side}Hand`;
    const before = this.capsules.length;
    for (const finger of USUAL.FINGERS) {
      const chain = USUAL.SEGMENTS.map((segment) => side + finger + segment).filter((name) => this.joints.has(name));
      if (!chain.length) continue;
      const thick = USUAL.THICKNESS[finger];
      const knuckle = this.bone(wrist, chain[0]!);
      const palm = [0.0095, thick * (finger === 'Thumb' ? 1.35 : 1.22)];
      this.add(`${side}${finger}Palm`, wrist, 'hand', knuckle.clone().multiplyScalar(0.12), knuckle, palm, side);
      chain.forEach((name, n) => {
        const bone = n + 1 < chain.length ? this.bone(name, chain[n + 1]!) : this.bone(n ? chain[n - 1]! : wrist, name).multiplyScalar(0.8);
        const taper = 1.12 - 0.09 * n;
        this.add(name, name, 'hand', new Vector3(), bone, [thick * taper, thick * (taper - 0.09)], side);
      });
    }
    if (this.capsules.length > before) return;
    const mitten = this.bone(`${side}LowerArm`, wrist).normalize().multiplyScalar(0.08 * this.height);
    this.add(`${side}Mitten`, wrist, 'hand', new Vector3(), mitten, [0.02, 0.018], side);
  }
}
