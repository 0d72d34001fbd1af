"""`python -m vfplan.conformance`: run a reader on the conformance kit."""

import sys

from vfplan.conformance.runner import main

sys.exit(main())
