// npx esbuild react.tsx --bundle --jsx=automatic --outfile=react.js
import type { SignPlayer, Word } from '@signsplice/sign-player';
import '@signsplice/sign-player';
import { type DetailedHTMLProps, type HTMLAttributes, useState } from 'react';
import { createRoot } from 'react-dom/client';

type Attributes = Partial<Pick<SignPlayer, 'src' | 'gloss' | 'service' | 'controls' | 'captions' | 'rate'>>;
declare module 'react' {
  namespace JSX {
    interface IntrinsicElements {
      'sign-player': DetailedHTMLProps<HTMLAttributes<SignPlayer>, SignPlayer> & Attributes & { onword?: (event: CustomEvent<Word>) => void };
    }
  }
}

function Sentence() {
  const [word, setWord] = useState('');
  const [rate, setRate] = useState(1);
  return (
    <>
      <h1>A sentence, in React</h1>
      <sign-player src="hello.glb" controls captions rate={rate} style={{ width: '24rem', height: '26rem' }}
        onword={({ detail }) => setWord(detail.gloss)} />
      <p>Now: <output>{word}</output></p>
      <button onClick={() => setRate(0.5)}>Slowly</button>
    </>
  );
}

createRoot(document.querySelector('#root')!).render(<Sentence />);
