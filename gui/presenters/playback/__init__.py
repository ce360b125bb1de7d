"""Playing a take or a stream: sources, transport, camera, timeline."""
