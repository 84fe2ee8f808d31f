/** Elements of the page. */

/** The element that there is one of. */
export function find<Kind extends HTMLElement>(query: string): Kind {
  return document.querySelector<Kind>(query)!;
}

export function option(value: string, text: string, title = ''): HTMLOptionElement {
  return Object.assign(document.createElement('option'), { value, textContent: text, title });
}
