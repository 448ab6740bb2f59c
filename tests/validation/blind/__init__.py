"""The identification against units whose truth it cannot read: a seeded generator, an oracle, rates with bounds."""
