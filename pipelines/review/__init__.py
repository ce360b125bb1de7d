"""Review in a browser: a take's quality, footage and marks, served beside its stream."""
