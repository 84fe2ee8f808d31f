"""Signs a typed line: reads it as glosses, spells names, sets the tempo, and draws the result with its report.

Run: python examples/02_sentence.py [FOLDER]     (writes FOLDER/sentence.bvh, .json and .png; default out/examples)
The picture needs the extra video: pip install '.[video]' in signsplice's folder.
"""

import sys
from pathlib import Path

import signsplice as ss

LINE = "Hello, my name is Anna. I like tea!"


def main(folder: Path) -> None:
    """Sign ``LINE`` with the words that ship."""
    folder.mkdir(parents=True, exist_ok=True)

    with ss.open_lexicon() as lexicon:
        # A gloss is the label of a sign. The line is read in its order and is not translated. A word that is no gloss
        # is spelled letter by letter, with a warning; nothing is replaced by a word that merely looks like it.
        tokens = ss.parse(LINE, lexicon)
        # A word is a clip with what the line says of it: where another spelled word begins, so that IS and ANNA are not
        # spelled as one, and at which words the sentence breathes. The lexicon says which arms are the word's own.
        words = ss.words_of(tokens, lexicon.clip, owns_of=lexicon.owns)
    for token in tokens:
        print(f"{token.token:8} {' '.join(token.glosses)}")
    for line in filter(None, (token.warning for token in tokens)):
        print(f"warning: {line}")

    # Dictionary signs are slow and end with a hold. The tempo "natural" shortens holds towards running signing.
    options = ss.SpliceOptions(tempo="natural")
    result = ss.splice(words, options)
    print(f"{len(words)} signs and letters, {result.clip.seconds:.2f} s, {result.tempo.seconds:.2f} s a sign")

    # The report holds every span, seam and warning. `signsplice view` and `signsplice render` mark its transitions.
    ss.save(result.clip, folder / "sentence.bvh")
    ss.write_report(result, folder / "sentence.json")
    ss.write_pictures(result.clip, folder / "sentence.png", result.marks)  # a .gif or .mp4 would be a film
    for suffix in ("bvh", "json", "png"):
        print(f"wrote {folder / f'sentence.{suffix}'}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples"))
