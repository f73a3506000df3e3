"""The commands of ``lanewise``, one file each; heavy imports happen after validation."""
