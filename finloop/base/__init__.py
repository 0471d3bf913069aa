"""Parts for every package, no method of the papers: arrays, schemas, errors, processes."""
