"""Parts for every room, no method of the papers: arrays, schemas, errors, settings, processes."""
