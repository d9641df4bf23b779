"""An interactive explorer of supersonic panel flutter and its suppression by piezoceramic patches."""

import os

# Read when numpy is first imported. The matrices here are small: on a machine that also draws the page, threads of the
# linear algebra wait for each other and make a rebuild many times slower.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
