"""V3 Studio's library: footage in, streamable Gaussian video out. It knows no take, job or window."""

import os

# OpenMP's threads spin while they wait. Where another program wants the same cores (a second job, the window, a
# browser), that makes every small torch operation wait for a whole time slice: measured, a training step on two busy
# cores took 787 ms with spinning and 42 ms without. Read when torch loads, so it is set before.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
