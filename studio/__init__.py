"""V3 Studio's library: from footage to a streamable Gaussian video. It knows no takes, jobs or windows."""
