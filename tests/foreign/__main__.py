"""Write the page of formats: what each keeps, by what its reader found in a file that was given all there is."""

import sys
from pathlib import Path

from foreign.table import page

if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
