"""What is known of each effect, and of pairs of them; everything else in the reality gap asks here."""
