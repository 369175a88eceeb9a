"""Commands that land all vehicles (land-all) or stop all motors (kill-all).

They work without a running supervisor, router, motion capture or copilot.

Only modules that import fast are used here (no numpy, no schema), because the first command must be sent well
within one second.
"""
