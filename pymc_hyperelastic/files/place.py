"""Where the package lies."""

import os.path

#: A warning that skips files under this path names the line that called the package.
PACKAGE = os.path.join(os.path.dirname(os.path.dirname(__file__)), "")
