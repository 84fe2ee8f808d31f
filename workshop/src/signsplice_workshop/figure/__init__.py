"""Makes the figure of ``signsplice.body.mesh`` from MakeHuman's base mesh."""
