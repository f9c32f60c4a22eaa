"""tsbench: does a self-driving planner obey the traffic sign in front of it, and still arrive?"""

__version__ = "0.1.0"
