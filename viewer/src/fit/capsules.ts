/** The body around an avatar's bones in the usual human SIZES, as the Python module body/capsules makes it. */

import { Vector3 } from 'three';
import type { FitCapsule } from '../wire.js';
import { type Bone, median, restPositions, SIDES } from './body.js';
import { capsules as USUAL, t_pose as SIZES } from './constants.js';

const { TRUNK_SIZES: TRUNK, HAND_SIZES: HAND } = USUAL;

/** A capsule of the usual SIZES. */
export interface UsualCapsule extends FitCapsule {
  /** Whether it is the last of a finger. */
  isTip: boolean;
}

const REGIONS: Record<string, FitCapsule['region']> = { face: 'head', nose: 'head', hair: 'head', sleeve: 'upperArm', cuff: 'lowerArm' };

/**
 * Capsules of head, trunk, arms and hands in the usual SIZES, of bones in the T-pose. ``tips``: where fingers may end,
 * from their last joints, by the names of these bones.
 */
export function usualCapsules(bones: Bone[], tips: ReadonlyMap<string, Vector3[]>): UsualCapsule[] {
  return new Usual(bones, tips).capsules;
}

/** Body height from the lengths of arms and legs, m. */
export function statureOf(bones: Bone[]): number {
  const rest = restPositions(bones);
  const joints = new Map(bones.map(({ name }, k) => [name, rest[k]!]));
  const { ARMS, LEGS, ARM_FRACTION, LEG_FRACTION } = SIZES;
  const chains = [...ARMS.map((chain) => [chain, ARM_FRACTION] as const), ...LEGS.map((chain) => [chain, LEG_FRACTION] as const)];
  const heights = chains.flatMap(([chain, fraction]) => {
    const [from, middle, to] = chain.map((name) => joints.get(name));
    return from && middle && to ? [(from.distanceTo(middle) + middle.distanceTo(to)) / fraction] : [];
  });
  return median(heights);
}

class Usual {
  readonly capsules: UsualCapsule[] = [];
  private readonly joints: Map<string, Vector3>;
  private readonly height: number;

  constructor(bones: Bone[], private readonly tips: ReadonlyMap<string, Vector3[]>) {
    const rest = restPositions(bones);
    this.joints = new Map(bones.map(({ name }, k) => [name, rest[k]!]));
    this.height = statureOf(bones);
    this.addHead();
    this.addTrunk();
    for (const side of SIDES) {
      this.addArm(side);
      this.addHand(side);
    }
  }

  /** Add a capsule with ends relative to its bone's joint; ``radii`` are fractions of stature. */
  private add(
    key: string, bone: string, region: FitCapsule['region'], start: Vector3, end: Vector3, radii: readonly number[],
    side: FitCapsule['side'] = '', isTip = false,
  ): void {
    const [r0, r1] = radii.map((radius) => radius * this.height) as [number, number];
    this.capsules.push({ key, bone, region, side, start: start.toArray(), end: end.toArray(), radii: [r0, r1], isTip });
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
    const { neck_overlap: beyond, neck_radii: radii } = TRUNK;
    this.add('neck', 'neck', 'head', this.point(0, -beyond), this.bone('neck', 'head').add(this.point(0, beyond)), radii);
  }

  private addTrunk(): void {
    const has = (name: string) => this.joints.has(name);
    const chest = ['upperChest', 'chest', 'spine', 'hips'].find(has)!;
    const low = ['spine', 'chest', 'hips'].find(has)!;
    for (const side of SIDES) {
      const collar = has(`${side}Shoulder`) ? `${side}Shoulder` : chest;
      const bone = this.bone(collar, `${side}UpperArm`);
      const { shoulder_span: [low, high], shoulder_radii: radii } = TRUNK;
      this.add(`${side}Shoulder`, collar, 'trunk', bone.clone().multiplyScalar(low), bone.clone().multiplyScalar(high), radii);
    }
    const girdle = SIDES.map((side) => this.bone(chest, `${side}UpperArm`));
    const middle = girdle[0]!.clone().add(girdle[1]!).divideScalar(2);
    const waist = this.bone(chest, low);
    const { waist_width: inward, waist_thickness: thinner } = TRUNK;
    TRUNK.columns.forEach(([x, r], n) => {
      const start = middle.clone().add(this.point(x, -TRUNK.column_drop));
      this.add(`chest${n}`, chest, 'trunk', start, waist.clone().add(this.point(inward * x, 0)), [r, thinner * r]);
    });
    if (has('neck')) {
      const nape = this.bone(chest, 'neck');
      this.add('back', chest, 'trunk', nape.clone().add(this.point(0, -TRUNK.back_drop)), waist, TRUNK.back_radii);
      const { collar_to_shoulder: outward, collar_to_middle: toMiddle, collar_drop: drop, collar_radii: thick } = TRUNK;
      girdle.forEach((shoulder, n) => {
        const end = shoulder.clone().multiplyScalar(outward).addScaledVector(middle, toMiddle).add(this.point(0, -drop));
        this.add(`collar${n}`, chest, 'trunk', nape, end, thick);
      });
    }
    const { hem_drop: drop, hem_width: spread, hem_radius: seat } = TRUNK;
    const hem = this.point(0, -drop);
    TRUNK.columns.forEach(([x, r], n) => {
      const start = this.bone('hips', low).add(this.point(inward * x, 0));
      this.add(`belly${n}`, 'hips', 'trunk', start, this.point(spread * x, -drop), [thinner * r, seat]);
    });
    if (!has('leftUpperLeg') || !has('rightUpperLeg')) return;
    const { hip_reach: reach, hip_radius: radius } = TRUNK;
    const [left, right] = SIDES.map((side) => this.bone('hips', `${side}UpperLeg`).multiplyScalar(reach).add(hem));
    this.add('hips', 'hips', 'trunk', left!, right!, [radius, radius]);
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
      const thick = USUAL.FINGER_RADII[finger];
      const knuckle = this.bone(wrist, chain[0]!);
      const { palm_start: from, palm_radius: narrow, knuckle_radius: wide, thumb_knuckle_radius: thumbWide } = HAND;
      const palm = [narrow, thick * (finger === 'Thumb' ? thumbWide : wide)];
      this.add(`${side}${finger}Palm`, wrist, 'hand', knuckle.clone().multiplyScalar(from), knuckle, palm, side);
      chain.forEach((name, n) => {
        const isTip = n + 1 === chain.length;
        const bone = isTip ? this.tip(name, this.bone(n ? chain[n - 1]! : wrist, name)) : this.bone(name, chain[n + 1]!);
        const { phalanx_radius: first, phalanx_taper: fall } = HAND;
        const taper = first - fall * n;
        this.add(name, name, 'hand', new Vector3(), bone, [thick * taper, thick * (taper - fall)], side, isTip);
      });
    }
    if (this.capsules.length > before) return;
    const { mitten_length: length, mitten_start_radius: from, mitten_end_radius: to } = HAND;
    const mitten = this.bone(`${side}LowerArm`, wrist).normalize().multiplyScalar(length * this.height);
    this.add(`${side}Mitten`, wrist, 'hand', new Vector3(), mitten, [from, to], side);
  }

  /** Where a finger ends beyond its last joint: at a node there, else a part of the phalanx before, straight on. */
  private tip(name: string, before: Vector3): Vector3 {
    const { shortest_tip: least, longest_tip: most, usual_tip: otherwise } = HAND;
    const usual = before.length();
    const found = this.tips.get(name)?.find((bone) => bone.length() > least * usual && bone.length() < most * usual);
    return found?.clone() ?? before.clone().multiplyScalar(otherwise);
  }
}
