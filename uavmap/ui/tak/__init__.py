"""The live map for TAK (Team Awareness Kit): a process that sends it as Cursor on Target."""
