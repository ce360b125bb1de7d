"""V3 Studio's library: footage in, streamable Gaussian video out. It knows no take, job or window."""
