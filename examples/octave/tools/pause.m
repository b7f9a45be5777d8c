function pause(varargin)
  % Do not wait: files of the course pause after each step for their plots.
end
