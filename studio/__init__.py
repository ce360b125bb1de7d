"""V3 Studio's library: from footage to a streamable Gaussian video. It does not depend on takes, runs or windows."""
