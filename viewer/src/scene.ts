/** A spliced sentence as the page shows it: its captions and its seams. */

import type { Word } from './api.js';
import type { Report, Span, Spliced } from './wire.js';

export interface SeamAt {
  before: string;
  after: string;
  /** Frames of the transition, half-open; empty if it has none. */
  from: number;
  to: number;
  seconds: number;
  peak: number | null;
  jump: number | null;
  warnings: string[];
}

/** The names of signs as people read them: those of letters without the ``fs-`` and ``@GSG`` of the lexicon. */
export function label(names: string): string {
  return names.replace(/(^|\s)fs-(\S+?)(@[a-z]{3})?(?=\s|$)/gi, '$1$2');
}

/** What a scene signs, in one line. */
export function titleOf({ name, units }: Spliced): string {
  return units.map(({ glosses, spelled }) => glosses.map(label).join(spelled ? '' : ' ')).join(' ') || label(name);
}

/** Seams in order, each with its frames in the output. */
export function seams(report: Report): SeamAt[] {
  const signs = report.spans.filter((span) => span.kind === 'sign');
  return report.seams.map((seam, k) => ({
    before: label(seam.before),
    after: label(seam.after),
    from: signs[k]?.output[1] ?? 0,
    to: signs[k + 1]?.output[0] ?? 0,
    seconds: seam.seconds,
    peak: seam.peak_speed_m_s,
    jump: seam.velocity_jump,
    warnings: seam.warnings,
  }));
}

/** The words of a scene in order. */
export function words(scene: Spliced): Word[] {
  const { fps, spans } = scene.report;
  const found: (Word & { unit: number })[] = [];
  for (const span of spans) {
    if (span.kind !== 'sign') continue;
    const of = unit(scene, span);
    const [start, end] = span.output.map((frame) => frame / fps) as [number, number];
    if (of && found.at(-1)?.unit === of.unit) found.at(-1)!.end = end;
    else found.push({ gloss: of?.text ?? label(span.name ?? ''), start, end, unit: of?.unit ?? -1 });
  }
  return found.map(({ gloss, start, end }) => ({ gloss, start, end }));
}

/** The words that are left out because nothing signs or spells them. */
export function leftOut({ units }: Spliced): string[] {
  return units.filter(({ glosses, warning }) => warning && !glosses.length).map(({ token }) => token);
}

/** The words that are spelled though they were not typed to be, as they were typed. */
export function spelled({ units }: Spliced): string[] {
  return units.filter((one) => one.spelled && !/^fs-/i.test(one.token)).map(({ token }) => token);
}

export function spanAt(report: Report, frame: number): number {
  const found = report.spans.findIndex((span) => frame < span.output[1]);
  return found < 0 ? report.spans.length - 1 : found;
}

export interface Caption {
  /** Text before, at and after the letter that is signed; a word has only the middle. */
  parts: [string, string, string];
  inTransition: boolean;
}

const NOTHING: Caption = { parts: ['', '', ''], inTransition: false };

/** The caption of a frame: a word, also while it is held or its hands come down, a letter in its spelled word, or a transition. */
export function caption(scene: Spliced, frame: number): Caption {
  const { spans } = scene.report;
  const at = spanAt(scene.report, frame);
  const span = spans[at];
  if (!span) return NOTHING;
  const isHeld = frame < (span.pause?.frames[1] ?? 0);
  if (span.kind !== 'transition') return { parts: partsOf(scene, span), inTransition: span.kind === 'retraction' && !isHeld };
  const [before, after] = [spans[at - 1], spans[at + 1]];
  if (before && (!after || isHeld)) return { parts: partsOf(scene, before), inTransition: !after };
  const [from, to] = [unit(scene, before), unit(scene, after)];
  if (from && to && from.unit === to.unit && after) return { parts: partsOf(scene, after), inTransition: true };
  const [left, right] = [from?.text ?? label(before?.name ?? ''), to?.text ?? label(after?.name ?? '')];
  return { parts: ['', `${left} → ${right}`, ''], inTransition: true };
}

function partsOf(scene: Spliced, span: Span): [string, string, string] {
  const found = unit(scene, span);
  if (!found?.letters) return ['', found?.text ?? label(span.name ?? ''), ''];
  const { letters, letter } = found;
  return [letters.slice(0, letter).join(''), letters[letter] ?? '', letters.slice(letter + 1).join('')];
}

/** The token of the sentence that a span belongs to. */
function unit(scene: Spliced, span: Span | undefined) {
  if (!span || span.clip === null || !scene.units.length) return null;
  let clip = span.clip;
  for (const [k, one] of scene.units.entries()) {
    if (clip < one.glosses.length) {
      const letters = one.spelled ? one.glosses.map(label) : null;
      return { unit: k, text: letters ? letters.join('') : label(one.glosses[0] ?? one.token), letters, letter: clip };
    }
    clip -= one.glosses.length;
  }
  return null;
}

/** A caption in one line of text. */
export function plain({ parts }: Caption): string {
  return parts.join('');
}

/** A line with a word of it replaced by a gloss, wherever it stands alone. */
export function replaced(line: string, word: string, gloss: string): string {
  const literal = word.replace(/[.*+?^${}()|[\]\\]/g, '\\$&').replaceAll("'", "['\u2018\u2019]");
  return line.replace(new RegExp(`(?<![\\p{L}\\p{N}])${literal}(?![\\p{L}\\p{N}])`, 'gu'), () => gloss);
}
