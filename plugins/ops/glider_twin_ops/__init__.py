"""Ops: a glider at sea, watched, judged, forecast and sent on its way."""
