/** What a player says to the page that it is on. */

export type View = 'front' | 'side' | 'hands';

/** A word of a sentence and when it is signed, s; a spelled word is one. */
export interface Word {
  gloss: string;
  start: number;
  end: number;
}

/** What the event `ready` says. */
export interface Ready {
  /** Length of what is shown, s; of what has come so far where a sentence is streamed. */
  duration: number;
  words: readonly Word[];
  /** What a user should know: words that are spelled, places beyond the reach of an avatar's arms, contacts that are not kept. */
  warnings: readonly string[];
}

/** The events of a player, beside those of every element. */
export interface SignPlayerEventMap {
  ready: CustomEvent<Ready>;
  word: CustomEvent<Word>;
  error: CustomEvent<{ message: string }>;
  play: CustomEvent<null>;
  pause: CustomEvent<null>;
  ended: CustomEvent<null>;
}
