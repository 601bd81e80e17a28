"""One drive, epoch after epoch: localized, tracked or found without a prior; and its table of poses."""
