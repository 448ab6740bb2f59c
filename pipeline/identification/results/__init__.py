"""What an identification leaves behind: errors, signatures, tables, corrected design."""
