"""Playing a take or stream: sources, transport, camera, timeline."""
