"""From photographs of an object to a mesh, with nothing to set by hand."""

import os

# Torch's threads wait in a loop for the next small tensor, and starve whatever else the cores do:
# beside other work a fit took 58 s in place of 6. It counts before torch is loaded.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
