/** Elements of the page. */

/** The one element that matches. */
export function find<Kind extends HTMLElement>(query: string): Kind {
  return document.querySelector<Kind>(query)!;
}

export function option(value: string, text: string, title = ''): HTMLOptionElement {
  return Object.assign(document.createElement('option'), { value, textContent: text, title });
}
