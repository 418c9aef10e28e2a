"""Arrays in, arrays out: slip detectors, decision rules, data files and scores."""
