"""`python -m tsbench`: the same as the command `tsbench`."""

from __future__ import annotations

from tsbench.cli import main

if __name__ == "__main__":
    main()
