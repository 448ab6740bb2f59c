"""Manufacturing errors of any sample of a study, counted and not consumed. Arrays have the sample axis first."""
