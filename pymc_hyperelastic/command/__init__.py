"""The command line: from the files of a laboratory to classes, decisions and a report."""
