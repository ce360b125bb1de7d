"""The places that files of a stream come from: a folder, a web server, or one file on either."""
