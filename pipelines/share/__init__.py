"""Sharing: the browser player with a stream, as a folder for any web server, as one HTML file, or served from here."""
