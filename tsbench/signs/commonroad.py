"""The numbers by which CommonRoad knows the catalogue's signs."""

from __future__ import annotations

# Numbers that CommonRoad gives to what our signs mean. It reads 209-10 as "turn right" and 220-20 as "one-way to the
# left", where the German catalogue has it the other way round: so these follow its names, not the catalogue.
SIGN_NUMBERS = {
    "2.1": "306", "2.3.1": "301", "2.3.2": "301", "2.3.3": "301", "2.4": "205", "2.5": "206", "3.1": "267",
    "3.2": "250", "3.24": "274", "3.25": "278", "4.1.1": "209-30", "4.1.2": "209-10", "4.1.3": "209-20",
    "4.2.1": "222-20", "4.2.2": "222-10", "4.3": "215", "4.6": "275", "5.7.1": "220-10", "5.7.2": "220-20",
    "5.14.1": "245", "5.14.2": "237", "5.19": "350", "5.21": "325.1", "5.22": "325.2", "5.31": "274.1",
    "5.32": "274.2",
}  # fmt: skip
