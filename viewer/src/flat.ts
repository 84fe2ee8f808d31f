/** Without WebGL: the film that the service draws, in place of its contact sheet. */

import { type Language, translateTo } from './languages.js';

/** Where pictures and messages appear. */
interface Shown {
  stage: HTMLElement;
  language: Language;
  show(picture: Blob): void;
  say(message: string): void;
  fail(message: string): void;
}

/** A button that shows the film, which is drawn once, or the sheet again. */
export function filmButton(draw: () => Promise<Blob>, sheet: Blob, { stage, language, show, say, fail }: Shown): HTMLButtonElement {
  const button = Object.assign(document.createElement('button'), { type: 'button', className: 'film', textContent: translateTo(language, 'film') });
  button.ariaPressed = 'false';
  let film: Promise<Blob> | null = null;
  button.addEventListener('click', () => {
    const isWanted = button.ariaPressed !== 'true';
    button.ariaPressed = String(isWanted);
    if (!isWanted) return show(sheet);
    stage.ariaBusy = 'true';
    say(translateTo(language, 'drawing'));
    (film ??= draw())
      .then((drawn) => {
        say(translateTo(language, 'flat'));
        if (button.ariaPressed === 'true') show(drawn);
      })
      .catch((error: unknown) => {
        film = null;
        button.ariaPressed = 'false';
        fail(error instanceof Error ? error.message : String(error));
      })
      .finally(() => (stage.ariaBusy = 'false'));
  });
  return button;
}
