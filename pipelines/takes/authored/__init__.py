"""Files that people make: edits, marks, camera paths, drawn masks."""
