"""What people make: edits, marks, camera paths, drawn masks."""
